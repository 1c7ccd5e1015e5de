"""What is noticed of a cable while it runs, and the lines that tell of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.methods import IMPLICIT
from dlo_sim.engine.arrays import TORSION
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import mirrors, needs_of
from dlo_sim.simulation import obstacles, self_contact
from dlo_sim.simulation.buckling import look_due, plane_warning, release, side_note
from dlo_sim.simulation.build_model import build_model
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.drawn_obstacles import drawn_obstacles
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import balance_warning
from dlo_sim.simulation.resolution import Shortfall, raised, shortfalls
from dlo_sim.simulation.running import Running

Array = NDArray[np.float64]
NOTABLE = 1e4  # energy exchanged, in floors of the account: as of a motion by 1e-4 lengths a second


# -- looks during a run -----------------------------------------------------------------------


def steps_until_look(sim: Running, steps: int) -> int:
    """At most `steps`, and none beyond the next look at a cable on a line or in a plane. One
    that is far from it will not be exactly there so soon.
    """
    every = sim.stepper.look_every
    if steps <= every - sim.steps % every:
        return steps
    every *= look_due(sim.cable)
    return min(steps, every - sim.steps % every) if every else steps


def look_for_buckling(sim: Running) -> None:
    """Look at a cable on a line or in a plane, where it is time to, and push it off."""
    every = sim.stepper.look_every
    if sim.steps % every == 0:
        every *= look_due(sim.cable)
        if every and sim.steps % every == 0:
            free = release(sim.cable)
            if free is not None and not side_taken(sim):
                across, axes = np.zeros((3, 3)), list(sim.model.axes)
                across[np.ix_(axes, axes)] = free
                sim.noticed.fell = sim.time, across


def look_at_itself(sim: Running) -> None:
    """Look whether the cable passes through itself, where it does not touch itself."""
    if "self_contact" not in sim.needs:
        x = sim.cable.x[: len(sim.model.axes)]
        sim.noticed.watch.look(sim.model, x, sim.time)


def look_back(sim: Running, recorder: Recorder, times: Array) -> dict[str, Array]:
    """What `drawn_obstacles` says of a recorded run, whose samples are at these times [s]. Its
    bends, and whether it passed through itself, are kept for `warnings`.
    """
    if "self_contact" not in sim.needs:
        sim.noticed.watch.reset()
        for time, x in zip(times.tolist(), recorder.control_points, strict=False):
            sim.noticed.watch.look(sim.model, x[:, :3].T, time)
    keep = partial(_keep_bends, sim)
    return drawn_obstacles(sim.cable, recorder, keep)


def look_at_start(sim: Running) -> None:
    """Note the directions in which the first shape leaves what mirrors it."""
    across = np.diag(mirrors(sim.scene))
    if side_note(sim.cable, 0.0, across):
        sim.noticed.fell = 0.0, across


def _keep_bends(sim: Running, cable: Cable, found: Mapping[str, obstacles.Contact]) -> None:
    """Keep the bends that knot spans cannot follow at one state of a recorded run; found: what
    touches there.
    """
    sim.noticed.bends = _bends_with(sim, cable, found)


# -- lines ------------------------------------------------------------------------------------


def warnings(sim: Running, found: Mapping[str, obstacles.Contact]) -> tuple[str, ...]:
    """`Simulator.warnings` with what touches now."""
    scene, cable = sim.scene, sim.cable
    itself = found.get(obstacles.ITSELF)
    bodies = {name: one for name, one in found.items() if name != obstacles.ITSELF}
    bends = _bends_with(sim, cable, found)
    needed = max((one.needed for one in bends.values()), default=0)
    settings = cure(sim, needed, stiffness_needed(sim, found))
    pressed = {
        name: obstacles.press_warning(name, one, scene, settings) for name, one in bodies.items()
    }
    lines = (
        sim.noticed.unstable_first,
        open_balance(sim),
        obstacles.thin_warning(sim.model),
        obstacles.mesh_warning(scene),
        obstacles.depth_warning(scene, float(cable.account.contact_deep)),
        *(obstacles.overlap_warning(*key, *seen) for key, seen in sim.noticed.overlaps.items()),
        *pressed.values(),
        *(one.warning(name, settings) for name, one in bends.items() if not pressed.get(name)),
        sim.noticed.watch.warning,
        *self_contact.warnings(cable, itself, settings),
    )
    return (*sim.needs.warnings, *filter(None, lines))


def notes(sim: Running) -> tuple[str, ...]:
    """`Simulator.notes` beside the warnings."""
    flat = "" if sim.noticed.unstable_first else unstable_in_plane(sim)
    more = flat, undefined_torsion(sim), side_taken(sim), floating_up(sim.scene)
    return tuple(filter(None, more))


def floating_up(scene: Scene) -> str:
    """One line if all of the cable is in water without a surface, in which it floats up; else
    empty.
    """
    lighter = any(one.scene.displaced > one.scene.cable.mu for one in scene.strands)
    if scene.water_surface is not None or not lighter or not any(scene.gravity):
        return ""
    return (
        f"water.level: not given, so the cable floats up in water of {scene.water.density:g} "
        "kg/m^3, which is everywhere; give the height of its surface"
    )


def undefined_torsion(sim: Running) -> str:
    """One line if the Frenet torsion was undefined somewhere in the run, else empty."""
    account, samples = sim.cable.account, int(np.count_nonzero(sim.model.rule.weights))
    if not (sim.model.has(TORSION) and account.torsion_worst):
        return ""
    return (
        "terms.twist frenet: torsion is undefined (curvature below "
        f"{sim.scene.curvature_floor:.3g} 1/m, where it is suppressed) at up to "
        f"{account.torsion_worst:.0f} of {samples} samples, "
        f"{account.torsion_sum / max(account.torsion_looks, 1.0):.1f} on average"
    )


def points_needed(sim: Running, found: Mapping[str, obstacles.Contact]) -> int:
    """`Simulator.control_points_needed` with what touches now."""
    bends = _bends_with(sim, sim.cable, found)
    return max((one.needed for one in bends.values()), default=0)


def stiffness_needed(sim: Running, found: Mapping[str, obstacles.Contact]) -> float:
    """`Simulator.contact_stiffness_needed` with what touches now.

    The key holds for all obstacles and the cable itself, so that it is no softer than what was
    chosen for any of them.
    """
    bodies = [one for name, one in found.items() if name != obstacles.ITSELF]
    diameter = sim.scene.cable.diameter
    needed = self_contact.stiffness_needed(sim.cable) if obstacles.ITSELF in found else 0.0
    needed = max([needed, *(obstacles.stiffness_needed(one, diameter) for one in bodies)])
    return max([needed, *(one.stiffness for one in found.values())]) if needed else 0.0


def cure(sim: Running, points: int, stiffness: float) -> str:
    """The one set of settings with which the cable follows its bends and is not pressed in too
    deep, in words; empty if the present ones do.
    """
    stiffer = f"raise contact.stiffness to {stiffness:.2g}" if stiffness else ""
    implicit = sim.choice.method.family == IMPLICIT
    finer = raised(sim.scene, points, implicit) if points else ""
    return " and ".join(filter(None, (stiffer, finer)))


def open_balance(sim: Running) -> str:
    """One line if the energy balance is open by more than the method may leave, else empty."""
    account, method = sim.cable.account, sim.choice.method
    if account.exchanged <= NOTABLE * account.floor:
        return ""
    return balance_warning(method, sim.scene.integrator.tolerance, sim.energy_error)


def side_taken(sim: Running) -> str:
    """One line if the cable has left a line or plane to a side that the scene leaves open."""
    return side_note(sim.cable, *sim.noticed.fell) if sim.noticed.fell else ""


def unstable_in_plane(sim: Running) -> str:
    """`plane_warning` of a copy in space, which takes 50 ms; empty if the cable is there
    anyway.
    """
    if len(sim.model.axes) == 3 or sim.scene.terms.out_of_plane != "off":
        return ""
    scene = replace(sim.scene, terms=replace(sim.scene.terms, out_of_plane="on"))
    copy = Running.resumed(sim.snapshot())
    copy.activate(build_model(scene, needs_of(scene), sim.held_now, sim.origin))
    return plane_warning(copy.cable)


def _bends_with(
    sim: Running, cable: Cable, found: Mapping[str, obstacles.Contact]
) -> dict[str, Shortfall]:
    """Bends that the knot spans cannot follow where contacts are known, and those kept."""
    now = shortfalls(cable.model, cable.points, found)
    return sim.noticed.bends | {
        name: max(sim.noticed.bends.get(name, one), one) for name, one in now.items()
    }
