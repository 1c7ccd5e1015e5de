"""`dlo_sim study validation --data DIR`: comparison of predictions with recorded cables, trivial
predictions without dynamics, a smooth cable fitted to the markers, and a prediction corrected by a
part of the markers, as seen by a camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.identification.measurement import START_FRAMES, Measurement
from dlo_sim.identification.prediction import (
    Score,
    begin,
    interpolated,
    marker_basis,
    mean_score,
    predict,
    score,
)
from dlo_sim.identification.readers import read_recordings
from dlo_sim.scene.description import Measured, Scene
from dlo_sim.scene.loading import SceneError, load_scene, shipped_scene
from dlo_sim.scene.nets import MAIN
from dlo_sim.session.diagnostics import Journal
from dlo_sim.session.observer import Observer
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import Outcome, Request
from dlo_sim.studies.report import Array, Report

PIECES = {True: 2, False: 1000}  # of a cable
SHOWN = (1.0, 2.5, 4.0)  # [s], times of the shapes in figures
EVERY = 25  # frames between two equilibria, and between two fitted splines
SEEN, RATE, NOISE = 0.3, 30.0, 0.005  # share of the markers, [Hz], [m] of each coordinate
BEFORE = 2  # frames before a piece of motion, for its first velocities
HEADER = (
    "cable | what | L1 [cm] | mean distance [cm] | worst piece L1 [cm] | bias [cm] | "
    "slow L1 [cm] | fast L1 [cm] | time per 10 ms [ms]"
)
EXPLANATION = """L1 is the sum over frames 2 and later of the mean absolute error of the markers'
coordinates, divided by the number of all frames; markers on the grippers count as exact. A
prediction starts from frames 0 and 1 and then uses only the poses of the grippers. Bias is the mean
over time of each piece; slow is the part slower than 0.5 s, fast the rest. First shape: held
constant. Moved: the first shape moved with the grippers, blended along the cable. At rest: the
scene's static equilibrium at the poses of the grippers. Corrected, of cables without branches: at
30 Hz by markers seen with a probability of 30 %, without identity and with 5 mm of noise in each
coordinate. Spline: a smooth cable of constant length fitted to the markers of each frame; its
distance is a noise floor for all predictions. Time: from poses to markers, on one core, once the
simulator is built and started."""


@dataclass(frozen=True)
class Cable:
    """Recordings of a cable, its scene, and their predictions.

    Attributes:
        predicted: markers of every piece. failures: of pieces whose simulation failed; from there
            on their last valid shape is used. scores: of every piece. seconds: per step of 10 ms.
    """

    name: str
    scene: Scene
    pieces: tuple[Measurement, ...]
    predicted: tuple[Array, ...]
    failures: tuple[str, ...]
    scores: tuple[Score, ...]
    seconds: float


def run_study(request: Request) -> Outcome:
    """Run the study into a folder.

    Raises:
        SceneError: no recordings, or no fitted scene for one of them.
    """
    folder = request.data
    if folder is None:
        raise SceneError("study validation: needs --data DIR with recordings (DLO1_calib.npz, ...)")
    files = sorted(folder.rglob("*DLO*.npz"))
    if not files:
        raise SceneError(f"--data {folder}: holds no *DLO*.npz; give the folder of the recordings")
    report = Report(request, "Recorded cables", {})
    report.text(EXPLANATION)
    verdicts: dict[str, str] = {}
    rows: list[list[Any]] = []
    cables: list[Cable] = []
    for number, path in enumerate(files):
        cable = _predicted(path, folder, PIECES[request.quick])
        rows += _rows(cable, request)
        cables.append(cable)
        mean, worst = mean_score(cable.scores), max(one.l1 for one in cable.scores)
        verdicts[cable.name] = (
            f"L1 {1e2 * mean.l1:.3f} cm, error of free markers {1e2 * mean.distance:.2f} cm, "
            f"worst piece {1e2 * worst:.2f} cm, {1e3 * cable.seconds:.3f} ms per 10 ms, "
            f"{len(cable.failures)} of {len(cable.pieces)} pieces failed"
        )
        request.progress((number + 1) / len(files))
    report.table("markers", HEADER, rows, "Error of the markers, mean of the pieces", ".3f")
    for cable in cables:
        report.section(cable.name)
        for failure in cable.failures:
            report.text(f"Failed: {failure}; its last valid shape is used from there on.")
        _charts(report, cable)
    return report.outcome(verdicts)


def scene_for(name: str, folder: Path) -> Scene:
    """The fitted scene of a cable: `<name>.yaml` in the folder, else that of the package.

    Raises:
        SceneError: there is none.
    """
    for place in (folder, shipped_scene("two_grippers").parent / "cables"):
        path = place / f"{name}.yaml"
        if path.is_file():
            return load_scene(path, {"initial.shape": "straight"})
    raise SceneError(
        f"{name}: has no fitted scene; make one: dlo_sim identify {name}_calib.npz --scene "
        f"two_grippers --output {folder / name}.yaml"
    )


def _predicted(path: Path, folder: Path, most: int) -> Cable:
    name = path.stem.removesuffix("_calib")
    scene = scene_for(name, folder)
    pieces = tuple(read_recordings(path)[:most])
    predict(scene, pieces[0])  # compiles
    made = [predict(scene, piece) for piece in pieces]
    seconds = sum(one.seconds for one in made) / sum(piece.duration for piece in pieces)
    both = list(zip(pieces, made, strict=True))
    scores = tuple(score(piece, one.markers) for piece, one in both)
    failures = tuple(f"{piece.name}: {one.failure}" for piece, one in both if one.failure)
    markers = tuple(one.markers for one in made)
    return Cable(path.stem, scene, pieces, markers, failures, scores, 0.01 * seconds)


def _rows(cable: Cable, request: Request) -> list[list[Any]]:
    items = [(cable.scene, piece) for piece in cable.pieces]
    others: dict[str, Sequence[Array]] = {
        "first shape": [held(piece) for piece in cable.pieces],
        "moved": [moved(piece) for piece in cable.pieces],
        "at rest": list(request.workers.map(resting, items)),
    }
    if not cable.scene.is_net:
        others["corrected"] = list(request.workers.map(corrected, items))
    rows = [_row(cable.name, "prediction", cable.scores, cable.seconds)]
    for what, predicted in others.items():
        scores = [score(*both) for both in zip(cable.pieces, predicted, strict=True)]
        rows.append(_row(cable.name, what, scores, None))
    floor = float(np.mean(list(request.workers.map(spline_distance, items))))
    rows.append([cable.name, "spline", None, floor, None, None, None, None, None])
    return rows


def _row(name: str, what: str, scores: Sequence[Score], seconds: float | None) -> list[Any]:
    mean, worst = mean_score(scores), max(one.l1 for one in scores)
    return [name, what, mean.l1, mean.distance, worst, mean.bias, mean.slow, mean.fast, seconds]


def _charts(report: Report, cable: Cable) -> None:
    """Add errors over time and shapes of the best, the median and the worst piece."""
    order = np.argsort([one.l1 for one in cable.scores])
    chosen = {"best": order[0], "median": order[len(order) // 2], "worst": order[-1]}
    if len(order) < 3:
        del chosen["median"]
    errors, shapes = [], []
    for word, k in chosen.items():
        piece, predicted = cable.pieces[k], cable.predicted[k]
        title = f"{word}: {piece.name}, L1 {1e2 * cable.scores[k].l1:.2f} cm"
        distance = np.nanmean(np.linalg.norm(predicted - piece.markers, axis=-1), axis=1)
        errors += [(title, *at) for at in zip(piece.times, distance, strict=True)]
        grippers = [path[:, None, :3] for path in piece.poses.values()]
        main = predicted[:, piece.on(MAIN)]
        whole = np.concatenate([grippers[0], main, *grippers[1:]], axis=1)
        for at in SHOWN:
            frame = int(np.argmin(np.abs(piece.times - at)))
            shapes += [(title, f"predicted, {at:g} s", x, z) for x, _, z in whole[frame]]
            shapes += [(title, f"measured, {at:g} s", x, z) for x, _, z in piece.markers[frame]]
    header, name = "piece | time [s] | mean distance [cm]", f"{cable.name}_pieces"
    report.chart(name, header, errors, f"{cable.name}: best, median and worst piece")
    looks: dict[str, dict[str, str]] = {}
    for k, at in enumerate(SHOWN):
        looks[f"predicted, {at:g} s"] = {"color": f"C{k}"}
        looks[f"measured, {at:g} s"] = {"color": f"C{k}", "linestyle": "", "marker": "o"}
    header, caption = "piece | shape | x [m] | z [m]", f"{cable.name}: shapes of these pieces"
    report.chart(f"{cable.name}_shapes", header, shapes, caption, equal=True, looks=looks)


def held(recording: Measurement) -> Array:
    """The first shape, held constant, (F, M, 3)."""
    return np.repeat(recording.markers[:1], len(recording.times), axis=0)


def moved(recording: Measurement) -> Array:
    """The first shape moved with the grippers, blended along the cable, (F, M, 3)."""
    shifts = np.stack([path[:, :3] - path[0, :3] for path in recording.poses.values()])
    at = np.array([*recording.held_at.values()])
    order = np.argsort(at)
    blend = [np.interp(recording.along, at[order], row) for row in np.eye(len(at))]
    return np.asarray(recording.markers[:1] + np.einsum("hm,hfc->fmc", blend, shifts[order]))


def resting(item: tuple[Scene, Measurement]) -> Array:
    """Static equilibria at the poses of the grippers, of an elastic cable, (F, M, 3)."""
    scene, recording = item
    # What slips depends on the way there; the share of the stiffness that does not slip remains.
    share = scene.plasticity.hardening if scene.plasticity.yield_curvature else 1.0
    values = {"cable.bending_stiffness": share * scene.cable.EI, "plasticity.yield_curvature": 0.0}
    scene = scene.with_values({"initial.shape": "equilibrium", **values})
    frames = _frames(recording)
    shapes: list[Array] = []
    for frame in frames:
        try:
            simulator = Simulator(scene, recording.ends_at(frame))
        except SceneError:  # no equilibrium found: repeat the previous one
            shapes.append(shapes[-1] if shapes else recording.markers[frame])
        else:
            shapes.append(marker_basis(simulator, recording) @ simulator.control_points[:, :3])
    return interpolated(recording.times, recording.times[frames], np.array(shapes))


def spline_distance(item: tuple[Scene, Measurement]) -> float:
    """Mean distance [m] of the free markers from a spline of the recorded length fitted to them:
    noise, slip and the resolution of the spline.
    """
    scene, recording = item
    still = {f"{end}.offset": [0.0, 0.0, 0.0] for end in scene.ends}
    scene = scene.with_values({**still, "cable.length": recording.known["cable.length"]})
    apart = []
    for frame in _frames(recording):
        simulator = Simulator(scene, recording.ends_at(frame))
        begin(simulator, recording, slice(frame, frame + 1))
        curve = marker_basis(simulator, recording) @ simulator.control_points[:, :3]
        apart.append(np.linalg.norm(curve - recording.markers[frame], axis=1))
    return float(np.nanmean(apart))


def _frames(recording: Measurement) -> NDArray[np.int64]:
    last = len(recording.times) - 1
    return np.unique(np.append(np.arange(0, last, EVERY), last))


def corrected(item: tuple[Scene, Measurement]) -> Array:
    """Markers [m] predicted with correction, (F, M, 3): markers are seen at random and without
    identity. After a failed step the last valid state is repeated.
    """
    scene, recording = item
    simulator = Simulator(scene, recording.ends_at(0))
    recording = begin(simulator, recording, slice(START_FRAMES))
    basis = marker_basis(simulator, recording)
    observer = Observer(Measured(noise=NOISE), Journal(()))
    rng, times = np.random.default_rng(0), recording.times
    looks = np.searchsorted(times, np.arange(1.0, times[-1] * RATE) / RATE - 1e-9)
    found, last = [basis @ simulator.control_points[:, :3]], 0
    for frame in np.unique([*looks, len(times) - 1]):
        part = slice(max(last - BEFORE, 0), frame + 1)
        along = {end: path[part] for end, path in recording.poses.items()}
        report, shapes = simulator.follow(times[part], along, times[last + 1 : frame + 1])
        found += list(basis @ shapes[:, :, :3])
        if not report.status.advanced:
            break
        seen = recording.markers[frame, rng.random(len(basis)) < SEEN]
        seen = seen[np.isfinite(seen).all(axis=1)]
        if len(seen):
            noisy = seen + rng.normal(0.0, NOISE, seen.shape)
            correction = observer.correction(noisy, simulator)
            if correction is not None:
                simulator.correct(*correction)
            found[-1] = basis @ simulator.control_points[:, :3]
        last = frame
    return np.array(found + found[-1:] * (len(times) - len(found)))
