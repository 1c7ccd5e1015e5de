"""The demo: generate a bag, replay it through a scene, draw, summarise."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from dlo_sim.demo import scenario
from dlo_sim.process.atomic_output import remove_leftovers, write_atomically
from dlo_sim.replay.bags import BagError, BagWriter
from dlo_sim.replay.replay import ReplayError, ReplayFigures, ReplaySummary, replay_bag
from dlo_sim.scene.loading import load_scene
from dlo_sim.view.page import write_page
from dlo_sim.view.run import Run, read_bag

SCENE, INPUT, PREDICTED = "scene.yaml", "input", "predicted"
PICTURE, PAGE = "motion.png", "motion.html"


class DemoError(Exception):
    """A demo that is refused: one line that names the folder and the cure."""


class DemoFailed(Exception):
    """A demo whose files could not all be written: one line; those that are there are whole."""


@dataclass
class DemoSummary(ReplayFigures):
    """Results of the demo: the figures of its replay, and these.

    Attributes:
        scene, input, predicted, page, picture: files written; picture is empty without matplotlib.
        notes: warnings of the replay, and what is missing with the cure.
        tip_speed_max: largest speed of the free end [m/s].
        reaction_max: largest force at the gripper [N]; reaction_rest: before it moves [N].
        try_next: suggestion -> its command.
    """

    scene: str = ""
    input: str = ""
    predicted: str = ""
    page: str = ""
    picture: str = ""
    notes: list[str] = field(default_factory=list)
    tip_speed_max: float = 0.0
    reaction_max: float = 0.0
    reaction_rest: float = 0.0
    try_next: dict[str, str] = field(default_factory=dict)


def run_demo(
    output_dir: str | Path,
    *,
    duration: float = scenario.DURATION,
    progress: Callable[[float], None] | None = None,
) -> DemoSummary:
    """Run the demo into a folder.

    Args:
        output_dir: created if missing; the results of an earlier demo in it are replaced.
        duration: of the generated bag [s].
        progress: called now and then with the fraction done.

    Raises:
        DemoError: the folder contains other files, or cannot be written; nothing was changed.
        DemoFailed: the disk is full.
        OSError: likewise, with the name of the file.
    """
    folder = Path(output_dir)
    _make_room(folder)
    write_atomically(folder / SCENE, lambda path: path.write_text(scenario.SCENE, encoding="utf-8"))
    scene = load_scene(folder / SCENE)
    try:
        _write_input(folder / INPUT, duration)
        replay = replay_bag(folder / INPUT, scene, folder / PREDICTED, progress=progress)
    except (BagError, ReplayError) as error:
        raise DemoError(str(error)) from None
    if replay.status == "output_incomplete":
        raise _removed(folder / PREDICTED, replay.message)
    prediction = read_bag(folder / PREDICTED, scene, origin_ns=scenario.EPOCH_NS)
    write_atomically(folder / PAGE, lambda path: write_page(prediction, path))
    summary = _summary(folder, replay, prediction)
    _draw(folder / PICTURE, prediction, duration, summary)
    return summary


def _make_room(folder: Path) -> None:
    """Create the folder; remove the results of an earlier demo and refuse other files."""
    mine = {SCENE, INPUT, PREDICTED, PAGE, PICTURE}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in mine:
            remove_leftovers(folder / name)
        found = {path.name for path in folder.iterdir()}
        if found - mine or (found and not _written_by_demo(folder / SCENE)):
            raise DemoError(
                f"{folder} holds {sorted(found - mine or found)[0]}, which is not of a demo; give "
                "an empty or a new folder"
            )
        for name in (PREDICTED, INPUT):
            if name in found:
                shutil.rmtree(folder / name)
        for name in (PICTURE, PAGE, SCENE):
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise DemoError(
            f"{folder} cannot be written ({error.strerror}); choose another folder"
        ) from None


def _written_by_demo(scene: Path) -> bool:
    try:
        return scene.read_text(encoding="utf-8").startswith(scenario.SIGNATURE)
    except (OSError, UnicodeDecodeError):
        return False


def _write_input(path: Path, duration: float) -> None:
    writer = BagWriter(path, scenario.TOPICS, "mcap")
    try:
        for message in scenario.messages(duration):
            writer.write(message.topic, message.time_ns, message.data)
        writer.finish()
    except BaseException:
        writer.discard()
        raise
    if writer.failure:
        raise _removed(path, writer.failure)


def _removed(path: Path, failure: str) -> DemoFailed:
    """The end of a demo whose bag is incomplete: a new one is as easily made."""
    shutil.rmtree(path)
    return DemoFailed(f"{failure.partition(';')[0]} and was removed; free space and run again")


def _summary(folder: Path, replay: ReplaySummary, prediction: Run) -> DemoSummary:
    tip = prediction.centerline[:, -1]
    speed = np.linalg.norm(np.diff(tip, axis=0), axis=1) / np.diff(prediction.time)
    force = np.linalg.norm(prediction.reactions["start"], axis=1)
    scene, bag = folder / SCENE, folder / INPUT
    again = f"dlo_sim replay {bag} --params {scene} --output {folder / 'again'}"
    figures = {figure.name: getattr(replay, figure.name) for figure in fields(ReplayFigures)}
    return DemoSummary(
        **figures,
        scene=str(scene),
        input=str(bag),
        predicted=str(folder / PREDICTED),
        page=str(folder / PAGE),
        notes=list(replay.warnings),
        tip_speed_max=float(speed.max()),
        reaction_max=float(force.max()),
        reaction_rest=float(force[0]),
        try_next={
            "a stiffer cable": f"{again} --set cable.bending_stiffness=0.1",
            "your own bag": "dlo_sim replay BAG --params SCENE.yaml --output OUT",
            "a film": f"dlo_sim view {folder / PREDICTED} --params {scene} --output motion.gif",
            "live": f"dlo_sim node --ros-args --params-file {scene}",
            "without a bag": "dlo_sim simulate paper_wire --duration 2",
        },
    )


def _draw(path: Path, prediction: Run, duration: float, summary: DemoSummary) -> None:
    try:
        from dlo_sim.demo.picture import draw_motion
    except ImportError as error:
        if not (error.name or "").startswith("matplotlib"):
            raise
        summary.notes.append("no picture: matplotlib is missing; pip install matplotlib")
        return
    t = np.arange(0.0, duration, 0.01)
    gripper, _ = scenario.gripper_pose(t)
    force = scenario.hand_wrench(t)[:, :3]
    motion, push = np.column_stack((t, gripper)), np.column_stack((t, force))
    write_atomically(path, lambda place: draw_motion(prediction, motion, push, place))
    summary.picture = str(path)
