"""What is fitted, as data, and how far a scene is from recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.batch.workers import Workers
from dlo_sim.core import rotations
from dlo_sim.identification.measurement import START_FRAMES, Measurement
from dlo_sim.identification.prediction import Sensor, predict
from dlo_sim.scene.description import Scene, scene_values

Array = NDArray[np.float64]
BETWEEN = 0.05  # [s] between frames that are compared: markers of a cable hardly move on their own
POINTS, POINTS_OF_HARNESS = 7, 4  # of the natural curvature
MARKER, FORCE = 0.02, 0.3  # [m], [N], errors beyond which a measurement counts less
MARKER_NOISE, FORCE_NOISE = 0.1, 0.3  # of these
YIELD, HARDENING = "plasticity.yield_curvature", "plasticity.hardening"
ELASTIC = 0.99  # hardening of a cable that is practically elastic
# Branches than the main cable of a scene: a harness of wires is hardly bent by its weight.
STIFFER = 100.0
ACROSS = 1  # component of a direction out of the plane in which branches are drawn
DELAY, OFFSET = "sensor.delay", "sensor.offset"


@dataclass(frozen=True)
class Unknown:
    """A number to fit.

    Attributes:
        key: of the scene, or DELAY or OFFSET. at: place in its list, or None.
        log: the fit uses the logarithm. width, reach: usual and largest change, in units of the
            fit.
        least, most: bounds; of a logarithm `least` is its start where the scene has less.
        stage: unknowns of a stage are added once those of the earlier ones are fitted.
        extra: fitted only where its key is asked for.
        spread: how far from its start it may be expected, in units of the fit; the distance in this
            unit counts as an error in `fit`.
    """

    key: str
    width: float
    reach: float
    at: int | None = None
    log: bool = False
    least: float = -np.inf
    most: float = np.inf
    stage: int = 0
    extra: bool = False
    spread: float = np.inf

    @property
    def label(self) -> str:
        """Key, and place in its list."""
        return self.key if self.at is None else f"{self.key}[{self.at}]"

    def seen(self, value: float) -> float:
        """What the fit sees of a value."""
        return float(np.log(max(value, self.least))) if self.log else value

    def range(self, start: float) -> tuple[float, float]:
        """Bounds of what the fit sees, from its start."""
        low = start - self.reach
        return (low if self.log else max(low, self.least)), min(start + self.reach, self.most)

    def value(self, seen: float) -> float:
        """The value of what the fit sees."""
        return float(np.exp(seen)) if self.log else float(seen)


def unknowns_of(scene: Scene, recording: Measurement) -> tuple[Unknown, ...]:
    """All that can be fitted to a scene from markers, or from forces."""
    length, mu, markers = scene.cable.length, scene.cable.mu, recording.forces is None
    if scene.branches:
        return tuple(_of_harness(scene))
    twisting = int(markers)  # with the natural curvature, by which twist moves markers
    material = (
        Unknown("cable.bending_stiffness", 1.0, 6.0, log=True, least=1e-4 * mu),
        Unknown("cable.torsional_stiffness", 1.0, 6.0, log=True, least=1e-4 * mu, stage=twisting),
        Unknown("damping.stiffness", 1.0, 6.0, log=True, least=0.03),
        Unknown("damping.air_drag", 0.2 * mu, 5.0 * mu, least=0.0),
        Unknown(YIELD, 1.0, 4.0, log=True, extra=True),
        Unknown(HARDENING, 0.2, 1.0, least=0.0, most=ELASTIC, extra=True),
    )
    if not markers:
        return (
            *material,
            *(Unknown(OFFSET, 0.3, 5.0, at=k) for k in range(3)),
            *(Unknown(DELAY, 0.03, 0.2, at=k) for k in range(3)),
        )
    return (
        *material,
        Unknown("cable.length", 0.02 * length, 0.1 * length),
        Unknown("damping.thinning", 0.03, 1.0, least=0.0, stage=2, extra=True),
        *(
            Unknown("cable.rest_curvature", 2.0 / length, 20.0 / length, at=k, stage=1)
            for k in range(POINTS)
        ),
        *(
            Unknown(
                "cable.rest_curvature_2", 2.0 / length, 20.0 / length, at=k, stage=2, extra=True
            )
            for k in range(POINTS)
        ),
        *(Unknown("cable.rest_curvature_axis", 0.5, 1.0, at=k, stage=2) for k in (0, 2)),
        *(Unknown(f"{end}.offset", 0.005, 0.03, at=0, stage=2) for end in ("start", "end")),
    )


def _of_harness(scene: Scene) -> Iterator[Unknown]:
    """What is fitted of a cable with branches. All lie around the main cable as the first frames
    and its curvature say, so that the first branch stays where it is drawn, and the others turn
    about the cable against it. Lengths and the other angles follow from the mean shape.
    """
    cable, turned = scene.cable, 0.2
    for key in ("cable.bending_stiffness", "cable.torsional_stiffness"):
        yield Unknown(key, 1.0, 6.0, log=True, least=1e-4 * cable.mu)
    for key in ("damping.bend", "damping.twist"):
        yield Unknown(key, 1.0, 6.0, log=True, least=0.03)
    yield Unknown("damping.air_drag", 0.2 * cable.mu, 5.0 * cable.mu, least=0.0)
    for number, branch in enumerate(scene.branches):
        key, mu = f"branches.{branch.name}", branch.cable.mu
        yield Unknown(
            f"{key}.cable.linear_density", 0.3, 2.0, log=True, least=1e-3 * mu, spread=0.3
        )
        yield Unknown(
            f"{key}.cable.bending_stiffness", 1.0, 3.0, log=True, least=1e-4 * mu, extra=True
        )
        for k in range(3):
            across = k == ACROSS
            if number or not across:
                yield Unknown(
                    f"{key}.direction", turned, 1.0, at=k, stage=1, extra=not across, spread=0.1
                )
    for key in ("cable.rest_curvature", "cable.rest_curvature_2"):
        for k in range(POINTS_OF_HARNESS):
            width, reach, spread = (size / cable.length for size in (2.0, 20.0, 1.2))
            yield Unknown(key, width, reach, at=k, stage=1, spread=spread)


def plastic(scene: Scene) -> Scene:
    """The scene with plastic bending; if it had none, with values that leave it almost elastic."""
    if scene.plasticity.yield_curvature:
        return scene
    return scene.with_values({YIELD: 1.0, HARDENING: ELASTIC})


def prepared(scene: Scene) -> Scene:
    """The scene with its derived values as numbers and its curvature as a list, to be changed.

    Branches as soft as the main cable become stiffer: those of recorded harnesses hardly bend. With
    branches, what is damped is bending and twist: damped stretching only makes steps slower.
    """
    cable, damping = scene.cable, scene.damping
    at = np.linspace(0.0, 1.0, POINTS_OF_HARNESS if scene.branches else POINTS)
    branches: dict[str, object] = {}
    if scene.branches:
        branches = {f"damping.{one}": 0.0 for one in ("stiffness", "stretch")}
        branches |= {"damping.bend": damping.internal[1], "damping.twist": damping.internal[2]}
    for branch in scene.branches:
        key, own = f"branches.{branch.name}.cable", branch.cable
        stiffer = STIFFER if own.EI == cable.EI else 1.0
        branches |= {
            f"{key}.bending_stiffness": stiffer * own.EI,
            f"{key}.torsional_stiffness": stiffer * own.GJ,
            f"{key}.linear_density": own.mu,
            f"{key}.axial_stiffness": own.EA,
        }
    first, second = (
        np.interp(at, np.linspace(0.0, 1.0, len(values)), values).tolist()
        for values in (cable.rest_curvature, cable.rest_curvature_2)
    )
    return scene.with_values(
        {
            "cable.bending_stiffness": cable.EI,
            "cable.torsional_stiffness": cable.GJ,
            "cable.linear_density": cable.mu,
            "cable.axial_stiffness": cable.EA,
            "cable.rest_curvature": first,
            "cable.rest_curvature_2": second,
            **branches,
        }
    )


@dataclass(frozen=True)
class Problem:
    """A scene, `prepared`, with numbers to fit to recordings."""

    scene: Scene
    unknowns: tuple[Unknown, ...]
    recordings: tuple[Measurement, ...]

    def start(self) -> Array:
        """What the fit sees of the scene's own values."""
        values = self._values
        start = [
            values[one.key] if one.at is None else values[one.key][one.at] for one in self.unknowns
        ]
        return np.array([one.seen(value) for one, value in zip(self.unknowns, start, strict=True)])

    def at(self, seen: Array) -> tuple[Scene, Sensor]:
        """The scene and the sensor with these values."""
        values, present = self._changed(seen), self._values
        delay, offset = (values.pop(key, present[key]) for key in (DELAY, OFFSET))
        return self.scene.with_values(values), Sensor(tuple(delay), tuple(offset))

    def errors(self, points: Sequence[Array], workers: Workers) -> list[Array]:
        """For each of several vectors the errors of all recordings (`error_of`), shape (T, N)."""
        pairs = [(*self.at(seen), one) for seen in points for one in self.recordings]
        errors = list(workers.map(error_of, pairs))
        count = len(self.recordings)
        return [
            np.concatenate(errors[first : first + count]) for first in range(0, len(errors), count)
        ]

    @property
    def noise(self) -> float:
        """Noise of the measurements by MARKER or FORCE; of a force, that of the arm's shocks."""
        return MARKER_NOISE if self.recordings[0].forces is None else FORCE_NOISE

    @property
    def pieces(self) -> NDArray[np.int64]:
        """Which recording each row of `errors` is of, shape (T,)."""
        counts = [len(one.times[compared(one)]) for one in self.recordings]
        return np.repeat(np.arange(len(counts)), counts)

    def disturbed(self, rng: np.random.Generator) -> Problem:
        """The problem with more of the markers' own noise on the frames from which it starts."""
        return replace(self, recordings=tuple(one.disturbed(rng) for one in self.recordings))

    @property
    def _values(self) -> dict[str, Any]:
        nothing = list(Sensor().delay)
        return {**scene_values(self.scene), DELAY: nothing, OFFSET: nothing}

    def _changed(self, seen: Array) -> dict[str, Any]:
        """Key -> value."""
        present = self._values
        changed: dict[str, Any] = {}
        for unknown, number in zip(self.unknowns, seen, strict=True):
            if unknown.at is None:
                changed[unknown.key] = unknown.value(number)
            else:
                row = changed.setdefault(unknown.key, list(present[unknown.key]))
                row[unknown.at] = unknown.value(number)
        for key in [key for key in changed if key.endswith(("_axis", ".direction"))]:
            changed[key] = (np.array(changed[key]) / np.linalg.norm(changed[key])).tolist()
        for branch in self.scene.branches:
            # The natural shape turns with the direction.
            direction = changed.get(f"branches.{branch.name}.direction")
            if direction is not None:
                swing = rotations.minimal_rotation(branch.direction, direction)
                axis = rotations.rotate(swing, np.array(branch.cable.rest_curvature_axis))
                changed[f"branches.{branch.name}.cable.rest_curvature_axis"] = axis.tolist()
        return changed


def compared(recording: Measurement) -> slice:
    """Which frames of a recording are compared."""
    every = max(1, round(BETWEEN / float(np.median(np.diff(recording.times)))))
    return slice(START_FRAMES, None, every)


def error_of(item: tuple[Scene, Sensor, Measurement]) -> Array:
    """Predicted less measured markers by MARKER and forces by FORCE at the compared frames, shape
    (T, 3 M) or (T, 3 M + 3); 0 where one is missing.
    """
    scene, sensor, recording = item
    predicted, chosen = predict(scene, recording, sensor), compared(recording)
    markers = (predicted.markers - recording.markers)[chosen] / MARKER
    rows = [markers.reshape(len(markers), -1)]
    if recording.forces is not None:
        rows.append((predicted.forces - recording.forces)[chosen] / FORCE)
    return np.nan_to_num(np.hstack(rows))
