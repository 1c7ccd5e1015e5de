"""The scene that the study measures: the paper's wire with Gauss quadrature, in motion."""

from __future__ import annotations

import numpy as np

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene, shipped_scene
from dlo_sim.simulation.simulator import Simulator

NAME = "paper_wire"
SAMPLES_PER_SPAN = 3
IMPLICIT_STEP = 2e-3  # [s], the paper's
SPEED = 0.3  # [m/s] of mid-span, downwards, at the start


def wire(control_points: int, method: str) -> Scene:
    """The wire with so many control points; explicit methods take the step chosen for them."""
    implicit = METHODS[method].family == IMPLICIT
    return load_scene(
        shipped_scene(NAME),
        {
            "discretization.control_points": control_points,
            "discretization.quadrature": "gauss",
            "discretization.samples": SAMPLES_PER_SPAN,
            "integrator.method": method,
            "integrator.step": IMPLICIT_STEP if implicit else 0.0,
        },
    )


def moving(control_points: int, method: str) -> Simulator:
    """The straight wire, released with half a sine wave of downward velocity.

    Every method can start so, an inextensible one too, and each size has the same motion: a wire
    that starts at rest hardly moves in the short steps of a fine one, whose iterations would then
    have nothing to do.

    Raises:
        SceneError: the method cannot hold the wire at this size.
    """
    simulator = Simulator(wire(control_points, method))
    rates = np.zeros((control_points, 4))
    phase = np.pi * simulator.greville / simulator.scene.cable.length
    rates[1:-1, 2] = -SPEED * np.sin(phase[1:-1])
    simulator.start_from(simulator.control_points, rates)
    return simulator
