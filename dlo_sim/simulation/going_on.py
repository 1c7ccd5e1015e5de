"""Going on: a cable of another scene from the present state of one that runs, and the code of what
may come to a cable.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dlo_sim.engine.grasps import ACTIVE
from dlo_sim.scene.description import Obstacle
from dlo_sim.simulation import obstacles, self_contact
from dlo_sim.simulation.buckling import grows, growth, look_due, release
from dlo_sim.simulation.build_model import build_model
from dlo_sim.simulation.geometry import moved
from dlo_sim.simulation.meshes import keep_triangles
from dlo_sim.simulation.reaction import reaction
from dlo_sim.simulation.running import Running


def take_over(sim: Running, other: Running) -> None:
    """Start with the present shape, motion and ends of another cable, whose scene has the same
    ends, grasps and loads, before the first step.
    """
    sim.replace_added(other.scene.added)
    if len(other.model.axes) > len(sim.model.axes):
        sim.needs = sim.needs.in_plane(sim.scene)
    way = other.origin - sim.origin
    points, rates = sim.cable.shape_of(other.cable, other.time)
    here = {*sim.scene.holders, *(one.name for one in sim.scene.bodies)}
    waiting = other.ends.queue.by_name
    sim.ends.queue.by_name = {
        name: tuple(motion.later(-other.time).moved(way) for motion in waiting[name])
        for name in waiting
        if name in here
    }
    sim.ends.take_over(other.ends, other.time, way)
    twists = other.cable.held_twists(other.time)
    sim.cable.count_twists(0.0, enumerate(twists))
    for name in sim.scene.holders:
        if sim.ends.state_of(name)[0][ACTIVE]:
            sim.move_along(name, sim.ends.state_of(name)[1])
    taking = _take_over_grasps(sim, other)
    for row, (name, holder) in enumerate(sim.scene.holders.items()):
        at = sim.geometries[name].u
        if at is not None and holder.holds_roll and not other.scene.holders[name].holds_roll:
            twists[row] = sim.curve_held(name).twist_at(at, points)
    sim.cable.count_twists(0.0, enumerate(twists))
    sim.cable.take_contact(other.cable, other.time)
    sim.cable.pull(sim.time)
    sim.ends.put(points, 0.0, twists)
    sim.cable.point_grasps(0.0)
    strained = other.cable.strained_joints()
    same = len(strained) == len(sim.cable.strained_joints())
    sim.cable.put(points, rates, 0.0, strained=strained if same else None)
    sim.cable.take_over_samples(other.cable)
    if sim.natural.follows and not sim.natural.equals(other.natural):
        sim.lay_natural_shape()
    sim.cable.flow()
    for grasp in taking:
        sim.hold(grasp, sim.geometry_taken(grasp, None))
    names = set(sim.touchable)
    sim.noticed.overlaps = {key: n for key, n in other.noticed.overlaps.items() if key[0] in names}
    kept = other.pressures
    sim.give_way(kept, obstacles.Overlap.CHANGED)
    sim.give_way(dict.fromkeys(names - kept.keys(), obstacles.UNTOUCHED))
    now, before = (
        {one.u for one in each.held_now.values() if one.u is not None} for each in (sim, other)
    )
    sim.cable.open_account(other.cable, sorted(before - now))
    sim.initial = sim.snapshot()


def _take_over_grasps(sim: Running, other: Running) -> list[str]:
    """Hold what the other cable's grasps hold, as far as the scene agrees; returns the
    names of the grasps that still have to take the cable.
    """
    held, taking = dict(sim.geometries), []
    theirs = moved(other.held_now, other.origin - sim.origin)
    for grasp in sim.scene.grasps:
        name, before = grasp.name, theirs[grasp.name]
        if grasp.taken and before.u is not None and grasp.at == other.scene.grasp(name).at:
            longer = sim.curve_held(name).length / other.curve_held(name).length
            held[name] = replace(before, u=before.u * longer)
            sim.ends.hold(name, held[name])
        else:
            held[name] = replace(held[name], u=None)
            slipped_out = before.u is None and other.scene.grasp(name).taken
            taking += [name] * (grasp.taken and not slipped_out)
    if sim.scene.grasps:
        sim.activate(build_model(sim.scene, sim.needs, held, sim.origin))
    return taking


def load_ahead(sim: Running) -> None:
    """Load the code of what may come, which no step or tick must have to compile: a look at whether
    the cable falls over, reading the state, and a grasp that takes or releases the cable.
    """
    cable, state = sim.cable, sim.cable.state.copy()
    if look_due(cable):
        release(cable)
        growth(cable, np.eye(len(sim.model.axes)))  # also if nothing presses it now
        grows(cable, np.zeros((len(sim.model.axes),) * 2), 1.0)
    cable.state[:] = state
    self_contact.nearest(sim.model, cable.points)
    sim.cable.velocities(0.0)
    sim.cable.balance()
    sim.cable.present_energy()
    if sim.scene.contact.markers and "contact" not in sim.needs:
        x, y, z = (sim.origin + 1e3 * sim.scene.cable.length).tolist()
        mesh = keep_triangles(obstacles.surface(Obstacle("box", "box")))
        body = Obstacle("body", "mesh", position=(x, y, z), mesh=mesh, mesh_cells=8)
        sim.replace_added((body,))
        _read(sim)
        sim.restore(sim.initial)
    for grasp in sim.scene.grasps:
        try:
            if sim.geometries[grasp.name].u is None:
                sim.hold(grasp.name, sim.geometry_taken(grasp.name, None))
            else:
                sim.hold(grasp.name, replace(sim.held_now[grasp.name], u=None))
        except ValueError:  # refused where it is now, not for ever
            continue
        _read(sim)
        sim.restore(sim.initial)


def _read(sim: Running) -> None:
    """Step and read the state as a node does, with the terms that are active now."""
    sim.stepper.advance(0, 0)
    for curve in sim.curves.values():
        curve.control_poses(sim.time, np.empty((len(curve.greville), 7)))
    for number in range(len(sim.scene.holders)):
        reaction(sim.cable, sim.time, number)
    sim.contacts  # noqa: B018
