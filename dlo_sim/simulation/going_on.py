"""Going on: a cable of another scene from the present state of one that runs, and the code of what
may come to a cable.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dlo_sim.engine.grasps import ACTIVE
from dlo_sim.scene.description import Obstacle
from dlo_sim.simulation import obstacles
from dlo_sim.simulation.core import Core
from dlo_sim.simulation.geometry import moved
from dlo_sim.simulation.meshes import as_text
from dlo_sim.simulation.reaction import reaction


def take_over(core: Core, other: Core) -> None:
    """Start with the present shape, motion and ends of another cable, whose scene has the same
    ends, grasps and loads, before the first step.
    """
    core.replace_added(other.scene.added)
    if len(other.model.axes) > len(core.model.axes):
        core.needs = core.needs.in_plane(core.scene)
    way = other.origin - core.origin
    points, rates = core.cable.shape_of(other.cable, other.time)
    here = {*core.scene.holders, *(one.name for one in core.scene.bodies)}
    core.ends.queue.take_over(other.ends.queue.by_name, here, other.time, way)
    core.ends.take_over(other.ends, other.time, other.cable.frame_turn, way)
    for name in core.scene.holders:
        if core.ends.state_of(name)[0][ACTIVE]:
            core.move_along(name, core.ends.state_of(name)[1])
    taking = _take_over_grasps(core, other)
    for name, holder in core.scene.holders.items():
        at = core.geometries[name].u
        if at is not None and holder.holds_roll and not other.scene.holders[name].holds_roll:
            core.ends.count_from(name, 0.0, core.curve.twist_at(at, points))
    obstacles.take_over(core.cable, other.cable, other.time)
    core.ends.pull_springs(core.cable, core.time)
    core.ends.put(points, 0.0)
    core.cable.point_grasps(0.0)
    core.cable.put(points, rates, 0.0)
    core.cable.take_over_samples(other.cable)
    core.cable.take_contact(other.cable, by_name=True)
    if core.natural.follows and not core.natural.equals(other.natural):
        core.lay_natural_shape()
    core.cable.flow()
    for grasp in taking:
        core.hold(grasp, core.geometry_taken(grasp, None))
    names = set(core.touchable)
    core.noticed.overlaps = {key: n for key, n in other.noticed.overlaps.items() if key[0] in names}
    kept = other.pressures
    core.give_way(kept, obstacles.Overlap.CHANGED)
    core.give_way(dict.fromkeys(names - kept.keys(), obstacles.UNTOUCHED))
    now, before = (
        {one.u for one in sim.held_now.values() if one.u is not None} for sim in (core, other)
    )
    core.cable.open_account(core.scene, other.cable, sorted(before - now))
    core.initial = core.snapshot()


def _take_over_grasps(core: Core, other: Core) -> list[str]:
    """Hold what the other cable's grasps hold, as far as the scene agrees; returns the
    names of the grasps that still have to take the cable.
    """
    held, taking = dict(core.geometries), []
    theirs = moved(other.held_now, other.origin - core.origin)
    for grasp in core.scene.grasps:
        name, before = grasp.name, theirs[grasp.name]
        if grasp.taken and before.u is not None and grasp.at == other.scene.grasp(name).at:
            longer = core.scene.cable.length / other.scene.cable.length
            held[name] = replace(before, u=before.u * longer)
            core.ends.hold(name, held[name])
        else:
            held[name] = replace(held[name], u=None)
            slipped_out = before.u is None and other.scene.grasp(name).taken
            taking += [name] * (grasp.taken and not slipped_out)
    if core.scene.grasps:
        core.activate(core.needs, held)
    return taking


def load_ahead(core: Core) -> None:
    """Load the code of what may come, which no step or tick must have to compile: reading the
    state, and a grasp that takes or releases the cable.
    """
    core.cable.velocities(0.0)
    core.cable.balance()
    core.cable.present_energy()
    if core.scene.contact.markers and "contact" not in core.needs:
        x, y, z = (core.origin + 1e3 * core.scene.cable.length).tolist()
        mesh = as_text(obstacles.surface(Obstacle("box", "box")))
        body = Obstacle("body", "mesh", position=(x, y, z), mesh=mesh, mesh_cells=8)
        core.replace_added((body,))
        _read(core)
        core.restore(core.initial)
    for grasp in core.scene.grasps:
        try:
            if core.geometries[grasp.name].u is None:
                core.hold(grasp.name, core.geometry_taken(grasp.name, None))
            else:
                core.hold(grasp.name, replace(core.held_now[grasp.name], u=None))
        except ValueError:  # refused where it is now, not for ever
            continue
        _read(core)
        core.restore(core.initial)


def _read(core: Core) -> None:
    """Step and read the state as a node does, with the terms that are active now."""
    core.stepper.advance(0, 0)
    core.curve.control_poses(core.time, np.empty((core.model.n, 7)))
    for number in range(len(core.scene.holders)):
        reaction(core.cable, core.time, number)
    core.contacts  # noqa: B018
