"""A smooth cable of the right length through measured points.

The control points q minimise
    mean |r(u_m) - p_m|^2 + BEND L^3 int |r''|^2 du + LENGTH L^2 mean (e^2 + excess^2)
subject to the constraints of ends and grasps, by Gauss-Newton steps from the solution without the
last term. There e is the mean of (|r'|^2 - 1) / 2 over each knot span: a spline that kept its
length at every point could hardly bend. excess is how far that of a quadrature point differs from
e beyond EVEN: where the span guard would act (`engine.span_guard`), which holds a hundred times the
energy of the cable. The velocities v minimise the same sum with r'.v' in place of e, without excess
and without constraints. A point far from the prediction of the others is a spike and is rejected.
BEND only selects among the curves that fit (with n_u = 17, predictions from 12 markers are the same
for 1e-9 to 1e-5). LENGTH keeps a stiff cable from starting under tension.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, bspline, quadrature, rotations
from dlo_sim.core.bent_line import bent_line
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.drawn_strands import with_bodies
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.model import MAIN, Model, Part
from dlo_sim.simulation.net import smooth_places

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
BEND, LENGTH = 1e-7, 1e2
BEND_OF_BRANCH = 1e-4  # against its unloaded shape, since it may have few points
EVEN = 0.07  # local strain beyond that of the span: half of where the span guard acts
SAMPLES = 3  # quadrature points of a knot span
STEPS, HALVINGS = 25, 6  # most Gauss-Newton steps, and halvings of one
ROUNDING = 1e-6  # of the length: change at which the iteration ends
SPIKE, CLEAR = 2.0, 0.02  # least distance of a spike: times that of the next point; of the length
OUTLIER = 6.0  # times the median distance of a point's frames from its path: weight 1/2
MOST_SPIKES = 0.3  # of the points
PROJECTIONS = 5  # of the points onto the curve, to find their coordinates
LEAST_APART = 1e-6  # [s] between frames; velocities of closer ones are noise
WITHIN = 1e-6, 2.0  # of the length: bounds of the median distance of the points from their middle
IN_PLANE = 1e-9  # of the length: distance from a plane that counts as round-off
SHORT = 1e-6  # [s] over which bodies move
QUADRATIC = 5  # number of frames from which the motion is a parabola instead of a line
MOST_KEPT = 500  # curves
_KEPT: dict[bytes, tuple[Array, Array]] = {}


class _Spline:
    """The sums to be minimised: knots, constraints, and the basis at quadrature points.

    Attributes:
        held: control points that satisfy the constraints at time 0, shape (n, 3).
        free: basis of the changes that satisfy them, shape (3 n, unknowns).
        length: rest length [m]. given: all that it is made of.
    """

    def __init__(
        self, held: tuple[Array, Array], knots: Array, unloaded: Array | None = None
    ) -> None:
        self.knots, self.length, self._unloaded = knots, float(knots[-1]), unloaded
        self.given = *held, knots, np.zeros(0) if unloaded is None else unloaded
        self._bend = BEND if unloaded is None else BEND_OF_BRANCH
        breaks = bspline.breaks(knots)
        rule = quadrature.gauss(breaks, SAMPLES)
        u = rule.places(breaks).ravel()
        self._weights = rule.weights.ravel()
        basis = np.eye(len(knots) - bspline.DEGREE - 1)
        self._slopes, self._bends = (bspline.evaluate(basis, knots, u, order) for order in (1, 2))
        rows, places = held
        self.held = (np.linalg.pinv(rows) @ places).reshape(-1, 3)
        self.free = np.linalg.svd(rows)[2][np.linalg.matrix_rank(rows) :].T

    def fitting(self, u: Array, values: Array, still: bool = False) -> tuple[Array, Array]:
        """Rows on the control points of the terms of points and bending, shape
        (3 m + 3 samples, 3 n), and their target values. `still`: of velocities.
        """
        bend = np.sqrt(self._bend * self.length**3 * self._weights)[:, None] * self._bends
        basis = bspline.evaluate(np.eye(len(self.held)), self.knots, u)
        rows = np.kron(np.vstack([basis / np.sqrt(len(u)), bend]), np.eye(3))
        wanted = np.zeros(len(rows))
        wanted[: values.size] = values.ravel() / np.sqrt(len(u))
        if self._unloaded is not None and not still:
            wanted[values.size :] = (bend @ self._unloaded).ravel()
        return rows, wanted

    def length_errors(self, points: Array) -> tuple[Array, Array]:
        """Weighted mean of (|r'|^2 - 1) / 2 over every span, then its weighted excess at every
        quadrature point, and the derivatives.
        """
        slope = self._slopes @ points
        weights = self._weights.reshape(-1, SAMPLES)
        spans = weights.sum(1, keepdims=True)
        shares = weights / np.where(spans > 0.0, spans, 1.0)  # void where knots coincide
        rows = (self._slopes[:, :, None] * slope[:, None, :]).reshape(*shares.shape, -1)
        strain = 0.5 * (np.sum(slope**2, axis=1) - 1.0).reshape(shares.shape)
        mean, of_mean = np.sum(shares * strain, axis=1), np.einsum("sk,skj->sj", shares, rows)
        apart = strain - mean[:, None]
        excess = apart - np.clip(apart, -EVEN, EVEN)
        of_excess = (rows - of_mean[:, None]) * (excess != 0.0)[..., None]
        of_spans, of_points = self.length * np.sqrt(LENGTH / np.array([mean.size, excess.size]))
        return np.append(of_spans * mean, of_points * excess), np.vstack(
            [of_spans * of_mean, of_points * of_excess.reshape(excess.size, -1)]
        )

    def solved(self, rows: Array, values: Array, held: Array) -> Array:
        """Control points that fit rows (m, 3 n) to values (m,) and keep the constraints."""
        unknowns = np.linalg.lstsq(rows @ self.free, values - rows @ held.ravel(), rcond=None)[0]
        return np.asarray(held + (self.free @ unknowns).reshape(held.shape))

    def through(self, u: Array, points: Array) -> Array:
        """Control points of the curve of the cable's length through points."""
        rows, values = self.fitting(u, points)
        # As many rows as unknowns have the same sum of squares, but for a constant.
        turn, rows = np.linalg.qr(rows)
        values = turn.T @ values
        curve = self.solved(rows, values, self.held)
        for _ in range(STEPS):
            error, derivative = self.length_errors(curve)
            apart = values - rows @ curve.ravel()
            present = apart @ apart + error @ error
            change = self.solved(
                np.vstack([rows, derivative]), np.append(apart, -error), np.zeros_like(curve)
            )
            for _ in range(HALVINGS):
                trial = curve + change
                error, apart = self.length_errors(trial)[0], values - rows @ trial.ravel()
                if apart @ apart + error @ error < present:
                    break
                change = 0.5 * change
            curve = curve + change
            if np.abs(change).max() < ROUNDING * self.length:
                break
        return curve

    def moving(self, u: Array, velocities: Array, curve: Array) -> Array:
        """Velocities of the control points that fit those of points and keep the length."""
        rows, values = self.fitting(u, velocities, still=True)
        derivative = self.length_errors(curve)[1][: len(self._weights) // SAMPLES]
        left = np.vstack([rows, derivative])
        right = np.concatenate([values, np.zeros(len(derivative))])
        return np.asarray(np.linalg.lstsq(left, right, rcond=None)[0].reshape(curve.shape))


def _held_rows(
    ends: EndDrive, model: Model, part: Part, known: Sequence[tuple[float, int, Array]]
) -> tuple[Array, Array]:
    """Constraint rows on the control points of a strand, shape (rows, 3 n), and their target
    values.

    Positions along fixed axes; for a clamp the components of r' normal to its tangent.

    Args:
        known: of joints: material coordinate, order of the derivative, and its value.
    """
    n, knots, names = part.model.n, part.model.knots, list(model.scene.holders)
    rows: list[Array] = [np.zeros(3 * n)]
    places = [0.0]
    for number, holder in enumerate(part.model.scene.holders.values(), part.grasp):
        name = names[number]
        u = model.geometries[name].u
        if u is None:
            continue
        value, slope = (bspline.evaluate(np.eye(n), knots, np.array([u]), k)[0] for k in (0, 1))
        fixed = list(holder.fixed)
        rows += [np.kron(value, axis) for axis in np.eye(3)[fixed]]
        places += ends.held_at(name, 0.0)[0][fixed].tolist()
        if holder.clamped:
            across = np.linalg.svd(ends.tangent(name, 0.0)[None])[2][1:]
            rows += [np.kron(slope, axis) for axis in across]
            places += [0.0, 0.0]
    for point in smooth_places(part):
        rows += [np.asarray(np.kron(point.values(model.n)[part.here], axis)) for axis in np.eye(3)]
        places += [0.0] * 3
    for at, order, wanted in known:
        value = bspline.evaluate(np.eye(n), knots, np.array([at]), order)[0]
        rows += [np.kron(value, axis) for axis in np.eye(3)]
        places += wanted.tolist()
    return np.array(rows), np.array(places)


def cable_through(
    ends: EndDrive,
    model: Model,
    points: ArrayLike | Mapping[str, ArrayLike],
    times: ArrayLike | None,
    coordinates: ArrayLike | Mapping[str, ArrayLike] | None,
) -> tuple[Array, Array]:
    """Control points [m], in the cable's coordinates, and velocities [m/s], each (n, 3), through
    points in the world; see `Simulator.start_from_points`.
    """
    names = {part.name for part in model.parts}
    by_strand = points if isinstance(points, Mapping) else {MAIN: points}
    own = coordinates if isinstance(coordinates, Mapping) else {MAIN: coordinates}
    if set(by_strand) != names:
        cure = f"give points of each cable, {{'{MAIN}': (M, 3), ...}}"
        raise ValueError(f"points: of {sorted(by_strand)}, for {sorted(names)}; {cure}")
    if unknown := set(own) - names:
        raise ValueError(f"coordinates: of {sorted(unknown)}; give those of {sorted(names)}")
    curve, rates = np.zeros((model.n, 3)), np.zeros((model.n, 3))
    for part in model.parts:
        frames, stamps = _frames(by_strand[part.name], times)
        given = frames - model.origin, stamps, own.get(part.name)
        known: list[tuple[float, int, Array]] = []
        joints: list[float] = []
        unloaded: Array | None = None
        for join in model.joins:
            if (join.strand, join.u) == (part.name, 0.0):
                other = next(one for one in model.parts if one.name == join.other)
                place, tangent = (
                    bspline.evaluate(curve[other.here], other.model.knots, [join.at], order)[0]
                    for order in (0, 1)
                )
                known.append((0.0, 0, place))
                if join.rigid:
                    turn = _turn_of_branch(part, other, tangent, given[0][0] - place)
                    unloaded = place + _unloaded(part) @ turn.T
                    known.append((0.0, 1, turn @ part.drawn[:, 0]))
            elif join.rigid and join.other == part.name:
                joints.append(join.at)
        for _ in range(1 + bool(joints)):
            spline = _Spline(_held_rows(ends, model, part, known), part.model.knots, unloaded)
            curve[part.here], rates[part.here] = _fitted(spline, part.model.scene, *given)
            # A body there has directors of unit length.
            slopes = bspline.evaluate(curve[part.here], part.model.knots, np.array(joints), 1)
            slopes /= np.linalg.norm(slopes, axis=1, keepdims=True)
            known += [(at, 1, slope) for at, slope in zip(joints, slopes, strict=True)]
        across = [axis for axis in range(3) if axis not in model.axes]
        plane = model.rest[across]
        if not np.any(np.abs(given[0][..., across] - plane) > IN_PLANE * spline.length):
            # The distance of the solution from the plane is round-off.
            curve[part.here, across], rates[part.here, across] = plane, 0.0
    if not model.bodies:
        return curve, rates
    turned, later = ends.orientation("start", 0.0), curve + SHORT * rates
    bodies, moved = (with_bodies(model, one, turned) for one in (curve, later))
    return bodies, (moved - bodies) / SHORT


def _unloaded(part: Part) -> Array:
    """Control points of the unloaded shape of a strand from the origin, in the frame in which it is
    drawn, shape (n, 3).
    """
    cable, knots = part.model.scene.cable, part.model.knots
    x = part.drawn[:, 0]
    axis = np.array(cable.rest_curvature_axis)
    axis = axis - (axis * x).sum() * x
    axis = axis / np.linalg.norm(axis) if cable.shaped else part.drawn[:, 1]
    frame = np.stack([x, axis, np.cross(x, axis)], axis=1)
    line = bent_line(frame, cable.natural_shape, part.length, bspline.greville(knots))
    return bspline.interpolate(knots, line)


def _turn_of_branch(part: Part, other: Part, tangent: Array, arms: Array) -> Array:
    """Rotation matrix of a branch from where it is drawn: its angle to the tangent [of what it
    begins at] stays, and about that its unloaded shape turns towards its points.

    Args:
        arms: from where it begins to the points [m], shape (M, 3), NaN where missing.
    """
    swing = rotations.to_matrix(rotations.minimal_rotation(other.drawn[:, 0], tangent))
    unloaded = _unloaded(part).mean(axis=0) @ swing.T
    along = tangent / np.linalg.norm(tangent)
    towards = np.nanmean(arms, axis=0)
    sine = (np.cross(unloaded, towards) * along).sum()
    cosine = (unloaded * towards).sum() - (unloaded * along).sum() * (towards * along).sum()
    roll = rotations.from_rotation_vector(np.arctan2(sine, cosine) * along)
    return np.asarray(rotations.to_matrix(roll) @ swing)


def _fitted(
    spline: _Spline, scene: Scene, frames: Array, stamps: Array, coordinates: ArrayLike | None
) -> tuple[Array, Array]:
    """Control points [m] and their velocities [m/s], each (n, 3), of the curve through the frames.

    The curves of the last calls are kept: `identify` begins at the same markers a thousand times,
    and without them a prediction of 5 s of a recorded harness takes 1.4 times as long.
    """
    if coordinates is None:
        return _fitted_anew(spline, scene, frames, stamps, None)
    u = arguments.numbers("coordinates", coordinates, (frames.shape[1],), "m")
    given = *spline.given, frames, stamps, u
    key = b"".join(repr(one.shape).encode() + one.tobytes() for one in given)
    if key not in _KEPT:
        if len(_KEPT) >= MOST_KEPT:
            del _KEPT[next(iter(_KEPT))]
        _KEPT[key] = _fitted_anew(spline, scene, frames, stamps, u)
    place, speed = _KEPT[key]
    return place.copy(), speed.copy()


def _fitted_anew(
    spline: _Spline, scene: Scene, frames: Array, stamps: Array, u: Array | None
) -> tuple[Array, Array]:
    place, speed = _at_zero(frames, stamps)
    seen: Mask = np.asarray(np.isfinite(place).all(axis=1))
    if seen.sum() < 2:
        raise ValueError(f"points: {seen.sum()} of {len(seen)} are known; give two or more")
    _check_extent(place[seen], spline.length)
    if u is None:
        u = np.full(len(seen), np.nan)
        u[seen] = _found(spline, scene, place[seen])
    else:
        if u.min() < 0.0 or u.max() > spline.length * (1.0 + 1e-9):
            raise ValueError(
                f"coordinates: {u.min():g} to {u.max():g} m leave the cable, 0 to "
                f"{spline.length:g} m; change them or cable.length"
            )
        if not np.all(np.diff(u) > 0.0):
            raise ValueError(
                f"coordinates: {arguments.given(u.tolist())} do not rise; give the points in their "
                "order from start to end, each with its own"
            )
    seen[seen] = _no_spikes(spline, u[seen], place[seen])
    curve = spline.through(u[seen], place[seen])
    known: Mask = np.asarray(seen & np.isfinite(speed).all(axis=1))
    if known.sum() < 2:
        return curve, np.zeros_like(curve)
    known[known] = _no_spikes(spline, u[known], speed[known], still=True)
    return curve, spline.moving(u[known], speed[known], curve)


def _frames(points: ArrayLike, times: ArrayLike | None) -> tuple[Array, Array]:
    """Points, shape (F, M, 3), NaN where missing, and their times [s], shape (F,)."""
    try:
        frames = np.asarray(points, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise TypeError("points: are no numbers; give rows x, y, z, NaN for missing") from None
    if np.isinf(frames).any():
        raise ValueError("points: are infinite; give NaN for missing ones")
    frames = frames[None] if frames.ndim == 2 else frames
    if frames.ndim != 3 or frames.shape[2] != 3:
        raise ValueError(f"points: shape {frames.shape}; give (M, 3), or (F, M, 3) with F times")
    stamps = np.zeros(1) if times is None else arguments.numbers("times", times, (None,), "s")
    if len(stamps) != len(frames):
        raise ValueError(f"times: {len(stamps)} for {len(frames)} frames of points; give one each")
    if not np.all(np.diff(stamps) >= LEAST_APART):
        raise ValueError(
            f"times: {arguments.given(stamps.tolist())} do not rise by {LEAST_APART:g} s or more; "
            "give each frame its time"
        )
    return frames, stamps


def _check_extent(points: Array, length: float) -> None:
    """Refuse points (M, 3) that do not fit the length; the median tolerates spikes."""
    distance = float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))
    least, most = WITHIN
    if not least * length <= distance <= most * length:
        raise ValueError(
            f"points: lie {distance:.3g} m from their middle (median) on a cable of {length:g} m; "
            "give points along it in m, or change cable.length"
        )


def _at_zero(frames: Array, times: Array) -> tuple[Array, Array]:
    """Positions and velocities at time 0, each (M, 3), from a line or parabola fitted to the frames
    of each point; outliers have low weights. NaN where too few frames are known.
    """
    place, speed = np.full((2, *frames.shape[1:]), np.nan)
    for m in range(frames.shape[1]):
        known = np.isfinite(frames[:, m]).all(axis=1)
        if not known.any():
            continue
        t, p = times[known], frames[known, m]
        powers = np.vander(t, min(len(t), 3 if len(t) >= QUADRATIC else 2), increasing=True)
        weight = np.ones(len(t))
        for _ in range(STEPS if len(t) > 2 else 1):
            fitted = np.linalg.lstsq(weight[:, None] * powers, weight[:, None] * p, rcond=None)[0]
            apart = np.linalg.norm(p - powers @ fitted, axis=1)
            weight = 1.0 / (1.0 + (apart / (OUTLIER * np.median(apart) + 1e-12)) ** 2)
        place[m] = fitted[0]
        if len(t) > 1:
            speed[m] = fitted[1]
    return place, speed


def _found(spline: _Spline, scene: Scene, points: Array) -> Array:
    """Material coordinates of points in their order along the cable: from the distances between
    them, then by projection onto the curve.
    """
    held = {name: any(end.fixed) for name, end in scene.ends.items()}
    chain = [spline.held[:1]] * held["start"] + [points] + [spline.held[-1:]] * held["end"]
    u = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(np.vstack(chain), axis=0), axis=1))]
    )
    if all(held.values()) or u[-1] > spline.length:
        u *= spline.length / u[-1]
    elif held["end"]:
        u += spline.length - u[-1]
    u = u[held["start"] :][: len(points)]
    for _ in range(PROJECTIONS):
        curve = spline.through(u, points)
        slope = bspline.evaluate(curve, spline.knots, u, 1)
        apart = points - bspline.evaluate(curve, spline.knots, u)
        u = u + np.sum(apart * slope, axis=1) / np.sum(slope**2, axis=1)
        u = np.maximum.accumulate(np.clip(u, 0.0, spline.length))
    return u


def _no_spikes(spline: _Spline, u: Array, values: Array, still: bool = False) -> Mask:
    """Mask of the points that are no spikes, shape (len(u),).

    Each spike is far from the prediction of the others, and without the spikes no other point is
    nearly as far. `still`: values are velocities, for which there are no constraints.
    """
    good = np.ones(len(u), dtype=bool)
    least = CLEAR * spline.length
    if still:
        least = SPIKE * float(np.median(np.linalg.norm(values, axis=1)))
    kept, left_out = good.copy(), list[float]()
    for _ in range(int(MOST_SPIKES * len(u)) + 1):
        distance = _to_prediction(spline, u[good], values[good], still)
        worst = int(np.argmax(distance))
        if left_out and min(left_out) > max(SPIKE * distance[worst], least):
            kept = good.copy()
        left_out.append(float(distance[worst]))
        if left_out[-1] <= least:
            break  # none of those that follow can be nearer than this and yet the least spike
        good[np.flatnonzero(good)[worst]] = False
    return kept


def _to_prediction(spline: _Spline, u: Array, values: Array, still: bool) -> Array:
    """Distance of each point from the curve, of any length, through the others.

    Omitting a point from a linear fit changes its distance d to d / (1 - h), where h is the
    influence of the point on its own fit.
    """
    rows, right = spline.fitting(u, values, still)
    free = np.eye(spline.held.size) if still else spline.free
    if not still:
        right -= rows @ spline.held.ravel()
    q, _ = np.linalg.qr(rows @ free)
    apart = (right - q @ (q.T @ right))[: values.size]
    influence = np.sum(q[: values.size] ** 2, axis=1)
    apart /= np.maximum(1.0 - influence, 1e-9)
    return np.asarray(np.linalg.norm(apart.reshape(-1, 3), axis=1) * np.sqrt(len(u)))
