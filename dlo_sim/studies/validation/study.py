"""`dlo_sim study validation --data DIR`: comparison of predictions with recorded cables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dlo_sim.identification.measurement import Recording
from dlo_sim.identification.prediction import predict
from dlo_sim.identification.readers import read_recordings
from dlo_sim.identification.scores import Score, mean_score, score
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, load_scene, shipped_scene
from dlo_sim.studies import Outcome, Request
from dlo_sim.studies.plotting import animate, new_figure
from dlo_sim.studies.report import Report
from dlo_sim.studies.runs import Array
from dlo_sim.studies.validation import references, robot_arm

PIECES = {True: 2, False: 1000}  # of a cable
PREDICTION = "prediction"
SHOWN = (1.0, 2.5, 4.0)  # [s], times of the shapes in figures
PER_SECOND = 10  # frames of the animation
HEADER = (
    "cable | what | L1 [cm] | mean distance [cm] | worst piece L1 [cm] | bias [cm] | "
    "slow L1 [cm] | fast L1 [cm] | time per 10 ms [ms]"
)
EXPLANATION = """L1 is the sum over frames 2 and later of the mean absolute error of the markers'
coordinates, divided by the number of all frames; markers on the grippers count as exact. A
prediction starts from frames 0 and 1 and then uses only the poses of the grippers. Bias is the mean
over time of each piece; slow is the part slower than 0.5 s, fast the rest. First shape: held
constant. Moved: the first shape moved with the grippers, blended along the cable. At rest: the
scene's static equilibrium at the poses of the grippers. Corrected: the prediction, corrected at
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
    pieces: tuple[Recording, ...]
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
    files = sorted(folder.rglob("DLO*.npz"))
    sets = robot_arm.sets_of(folder)
    if not files and not sets:
        raise SceneError(
            f"--data {folder}: holds no DLO*.npz and no static/ or bags/ of a robot arm; give the "
            "folder of the recordings"
        )
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
        request.progress(0.8 * (number + 1) / (len(files) + len(sets)))
    if rows:
        report.table("markers", HEADER, rows, "Error of the markers, mean of the pieces", ".3f")
    for cable in cables:
        for failure in cable.failures:
            report.text(f"Failed: {failure}; its last valid shape is used from there on.")
        _pictures(report, cable)
    verdicts |= robot_arm.compare(report, sets, request)
    request.progress(1.0)
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
    name = path.stem.partition("_")[0]
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
        "first shape": [references.held(piece) for piece in cable.pieces],
        "moved": [references.moved(piece) for piece in cable.pieces],
        "at rest": list(request.workers.map(references.resting, items)),
        "corrected": list(request.workers.map(references.corrected, items)),
    }
    rows = [_row(cable.name, PREDICTION, cable.scores, cable.seconds)]
    for what, predicted in others.items():
        scores = [score(*both) for both in zip(cable.pieces, predicted, strict=True)]
        rows.append(_row(cable.name, what, scores, None))
    floor = float(np.mean(list(request.workers.map(references.spline_distance, items))))
    rows.append([cable.name, "spline", None, floor, None, None, None, None, None])
    return rows


def _row(name: str, what: str, scores: Sequence[Score], seconds: float | None) -> list[Any]:
    mean, worst = mean_score(scores), max(one.l1 for one in scores)
    return [name, what, mean.l1, mean.distance, worst, mean.bias, mean.slow, mean.fast, seconds]


def _pictures(report: Report, cable: Cable) -> None:
    """Add the figure of the best, median and worst piece, and an animation of the worst."""
    order = np.argsort([one.l1 for one in cable.scores])
    chosen = {"best": order[0], "median": order[len(order) // 2], "worst": order[-1]}
    figure, axes = new_figure(2, 3, 12.0, 7.0)
    data: dict[str, list[Array]] = {"time [s]": []}
    for column, (word, k) in enumerate(chosen.items()):
        piece, predicted = cable.pieces[k], cable.predicted[k]
        distance = np.nanmean(np.linalg.norm(predicted - piece.markers, axis=-1), axis=1)
        axes[column].plot(piece.times, 1e2 * distance)
        axes[column].set(
            title=f"{word}: {piece.name}, L1 {1e2 * cable.scores[k].l1:.2f} cm",
            xlabel="time [s]",
            ylabel="mean distance [cm]" if column == 0 else "",
        )
        axes[column].grid(alpha=0.3)
        for time_s, color in zip(SHOWN, ("tab:blue", "tab:orange", "tab:green"), strict=True):
            frame = int(np.argmin(np.abs(piece.times - time_s)))
            line, dots = _chain(piece, predicted[frame], frame), piece.markers[frame]
            axes[3 + column].plot(line[:, 0], line[:, 2], color=color, label=f"{time_s:g} s")
            axes[3 + column].plot(dots[:, 0], dots[:, 2], ".", color=color)
        axes[3 + column].set(xlabel="x [m]", ylabel="z [m]" if column == 0 else "", aspect="equal")
        axes[3 + column].legend(fontsize="small")
        data["time [s]"].append(piece.times)
        data.setdefault("piece", []).append(np.full(len(piece.times), int(k)))
        data.setdefault("mean distance [m]", []).append(distance)
    columns = {name: np.concatenate(parts) for name, parts in data.items()}
    report.section(cable.name)
    caption = f"{cable.name}: best, median and worst piece. Lines: predicted; dots: measured."
    report.figure(f"{cable.name}_pieces", figure, columns, caption)
    _animation(report, cable, int(order[-1]))


def _animation(report: Report, cable: Cable, k: int) -> None:
    piece, predicted = cable.pieces[k], cable.predicted[k]
    every = max(1, round(1.0 / (PER_SECOND * float(np.median(np.diff(piece.times))))))
    frames = np.arange(0, len(piece.times), every)
    figure, (axes,) = new_figure(1, 1, 5.0, 5.0)
    everything = piece.markers.reshape(-1, 3)
    low, high = np.nanmin(everything, axis=0) - 0.1, np.nanmax(everything, axis=0) + 0.1

    def draw(frame: int) -> None:
        axes.clear()
        at = frames[frame]
        line = _chain(piece, predicted[at], at)
        axes.plot(line[:, 0], line[:, 2], color="tab:red")
        axes.plot(piece.markers[at, :, 0], piece.markers[at, :, 2], "k.")
        axes.set(
            xlim=(low[0], high[0]),
            ylim=(low[2], high[2]),
            aspect="equal",
            title=f"{piece.name}, {piece.times[at]:.1f} s",
        )

    file = f"{cable.name}_worst.gif"
    animate(report.folder / file, figure, draw, len(frames), PER_SECOND)
    error = np.nanmean(np.linalg.norm(predicted - piece.markers, axis=-1), axis=1)[frames]
    columns = {"time [s]": piece.times[frames], "mean distance [m]": error}
    report.attach(file, columns, f"{cable.name}, worst piece. Red: predicted; black: measured")


def _chain(piece: Recording, markers: Array, frame: int) -> Array:
    """Predicted markers with the grippers at both ends."""
    ends = [
        piece.poses[end][frame : frame + 1, :3] for end in ("start", "end") if end in piece.poses
    ]
    return np.concatenate([ends[0], markers, *ends[1:]])
