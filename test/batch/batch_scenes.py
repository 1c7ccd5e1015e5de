"""Scenes that the batch tests share: one of them as often as wanted, each a little different."""

from cables import SOFT, scene_of

from dlo_sim.scene.loading import load_scene

STEP = 8e-6  # [s] of the wire


def wire(k, **more):
    """The paper's wire, planar, on springs, with a diameter and an end spring of its own."""
    values = {
        "discretization.control_points": 13,
        "discretization.quadrature": "gauss",
        "discretization.samples": 3,
        "cable.diameter": 0.002 + 1e-4 * k,
        "start.spring": [1e4 / (1 + k), 0.0, 0.0],
        "integrator.step": STEP,
    }
    return load_scene("paper_wire", values | more)


def pulled(k, **more):
    """A soft damped cable in space, clamped, pulled by a load of its own at a place of its own."""
    signal = "sine" if k % 2 else "constant"
    values = SOFT | {
        "cable.length": 1.0 + 0.05 * k,
        "damping.mass": 0.2 + 0.1 * k,
        "loads.tip.type": "force",
        "loads.tip.signal": signal,
        "loads.tip.force": [0.02 * k, 0.1, -0.05],
        "loads.tip.position": 0.3 + 0.08 * k,
        "loads.tip.frequency": 2.0 + k,
        "integrator.method": "velocity_verlet",
        "integrator.step": 5e-4,
    }
    return scene_of(values | more)
