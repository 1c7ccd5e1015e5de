"""Equilibrium of a cable with plastic flow, twist from its natural shape, or a constant length.

`lay` aligns the natural shape with the present shape and lets plastic flow follow.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np

from dlo_sim.core.methods import METHODS
from dlo_sim.engine import layout
from dlo_sim.scene.description import Scene
from dlo_sim.simulation import statics
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.dynamic_relaxation import relative_movement, relax_in_time
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.frequency import largest_frequency
from dlo_sim.simulation.stepper import loop_of

Lay = Callable[[], None]
SHARE_OF_TIME = 0.01  # step of the relaxation, relative to `_time_scale`
LONGEST = 1.0  # [s], time scale of a cable without weight or stiffness
EXTENSIBLE = 1e-8, 5_000  # tolerance and most steps of `relax_in_time`
INEXTENSIBLE = 1e-7, 40_000
MAX_ALTERNATIONS = 30
CONTRACTION = 0.7  # of the movement by one alternation, or they are given up
CONVERGED = 1e-9  # movement by an alternation, relative to the length or 1 rad


def of_shape(cable: Cable, lay: Lay | None) -> bool:
    """Whether an equilibrium was found for the twist as it is, with plastic flow up to it. Where
    the search with flow fails, as for stiff wires, with the flow up to the first guess and a
    UserWarning.
    """
    begin = cable.state.copy()
    flow = _flow(cable, lay)
    if statics.relax(cable, flow):
        return True
    cable.state[:] = begin
    if flow is None or not statics.relax(cable):
        return False
    warnings.warn(
        "initial.shape: the search with plastic flow did not converge; the cable moves after the "
        "start: let it come to rest, or raise plasticity.hardening",
        stacklevel=2,
    )
    return True


def with_twist(scene: Scene, ends: EndDrive, cable: Cable, lay: Lay) -> bool:
    """Whether shape and twist of a cable with a natural shape in the material frame are in
    equilibrium together: found by solving for them in turn, or else by steps in time. Where both
    fail, the cable has the shape of the last search that succeeded.
    """
    before = cable.state.copy()
    if _in_turn(ends, cable, lay):
        return True
    alternated = cable.state.copy()
    cable.state[:] = before
    loop = loop_of(METHODS["energy_momentum"], scene)
    step = SHARE_OF_TIME * _time_scale(scene)
    if relax_in_time(cable, loop, step, lambda: _stop(scene, ends, cable, lay), *EXTENSIBLE):
        return True
    cable.state[:] = alternated
    return False


def of_inextensible(scene: Scene, ends: EndDrive, cable: Cable, lay: Lay | None) -> bool:
    """Whether a cable of constant length came to rest by steps in time."""
    step = min(0.5 / max(largest_frequency(scene, cable), 1e-3), 5e-3)
    loop = loop_of(METHODS["rattle"], scene)
    return relax_in_time(cable, loop, step, lambda: _stop(scene, ends, cable, lay), *INEXTENSIBLE)


def _in_turn(ends: EndDrive, cable: Cable, lay: Lay) -> bool:
    """Solve in turn for the twist and for the shape; whether that converged. The state is that of
    the last search that succeeded.
    """
    last, found = np.inf, cable.state.copy()
    for _ in range(MAX_ALTERNATIONS):
        before = cable.x.copy()
        if not statics.relax_twist(cable):
            return False
        _put(ends, cable, lay)
        if not statics.relax(cable, _flow(cable, lay)):
            break
        moved = relative_movement(cable, before)
        if moved < CONVERGED:
            return True
        if moved > CONTRACTION * last:
            break
        last, found = moved, cable.state.copy()
    cable.state[:] = found
    return False


def _flow(cable: Cable, lay: Lay | None) -> Lay | None:
    """What a search does after each step."""
    return lay if cable.model.has(layout.PLASTICITY) else None


def _put(ends: EndDrive, cable: Cable, lay: Lay | None) -> None:
    """Put the cable at rest, with its ends where they are held."""
    points = cable.points
    ends.put(points, 0.0)
    cable.put(points, np.zeros_like(points))
    if lay:
        lay()


def _stop(scene: Scene, ends: EndDrive, cable: Cable, lay: Lay | None) -> None:
    """Take the velocity away, and open a new energy account."""
    _put(ends, cable, lay)
    cable.open_account(scene)


def _time_scale(scene: Scene) -> float:
    """1 / hypot of the rates sqrt(g / L) and sqrt(EI / mu) / L^2 [s], at most LONGEST."""
    cable = scene.cable
    bending = np.sqrt(cable.EI / cable.mu) / cable.length**2
    swinging = np.sqrt(float(np.linalg.norm(scene.gravity)) / cable.length)
    return 1.0 / max(float(np.hypot(bending, swinging)), 1.0 / LONGEST)
