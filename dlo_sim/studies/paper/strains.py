"""Strains that the paper defines without results: Frenet torsion and plastic bending."""

from __future__ import annotations

import numpy as np

from dlo_sim.core import bspline, elasticity
from dlo_sim.core.plasticity import Law
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.paper.wires import Paper, scenario
from dlo_sim.studies.plotting import draw, new_figure
from dlo_sim.studies.runs import Array, at_method, each

FLOORS = {
    True: (1.0, 0.1, 0.0314159, 0.01),
    False: (10.0, 1.0, 0.3, 0.1, 0.0314159, 0.01, 0.003, 0.001),
}  # [1/m]
SMALLEST_SHARE = 0.125  # of the linear bound, smallest step tried
PEAK = 4.0  # curvature to which the strip is bent [1/m]
STRIP = {
    "cable.length": 1.0,
    "cable.diameter": 0.02,
    "cable.linear_density": 0.1,
    "cable.axial_stiffness": 60.0,
    "cable.bending_stiffness": 0.02,
    "discretization.control_points": 8,
    "gravity": [0.0, 0.0, 0.0],
    "start.clamped": True,
    "loads.names": ["tip"],
    "terms.twist": "off",
    "damping.mass": 3.0,
    "plasticity.yield_curvature": 1.5,
    "plasticity.hardening": 0.2,
    "integrator.method": "velocity_verlet",
}


def add(paper: Paper) -> None:
    """Add the breakdown of the Frenet torsion, and plastic bending against its closed form."""
    paper.report.text(
        """gamma = C.r'''/|C|^2 is 0/0 on a straight cable, such as the paper's wire initially; here
        it is C.r'''/(|C|^2 + delta^2) with a curvature floor delta, by default 1 % of the curvature
        of the cable bent to a closed ring. Samples below the floor are counted, and a run never
        yields a NaN. The stable step is proportional to the floor, the force per torque to 1 /
        delta^2: for small floors even the bound of the linearised wire is not sufficient. Without
        an explicit request, twist is relative to a rotation-minimising frame.""",
        """The paper has no evolution law for its plastic strain eps0. Here every quadrature point
        has a plastic curvature vector with a yield curvature and linear kinematic hardening,
        updated once per step by return mapping.""",
    )
    _frenet(paper)
    _plastic(paper)


def _frenet(paper: Paper) -> None:
    duration = 0.05 if paper.quick else 0.5
    cases = [(floor, duration) for floor in FLOORS[paper.quick]]
    runs = list(each(paper.workers, _surviving, cases).values())
    paper.report.table(
        "frenet_floor",
        "floor [1/m] | step [us] | survived at | energy error | samples without torsion [%] {:.0f}",
        [[*row[:2], f"{row[2]:g} of it", *row[3:]] for row in runs],
        f"Scenario 2 with twist measured against the Frenet torsion, velocity Verlet, "
        f"{duration:g} s; step: 0.9 of the linear bound; 0 of it: none down to {SMALLEST_SHARE:g}",
    )
    floors, steps, shares, _, empty = (np.array(column) for column in zip(*runs, strict=True))
    floor, without = "curvature floor [1/m]", "samples without torsion"
    bound, survived = "step from the linear bound [s]", "step that survived [s]"
    data = {floor: floors, bound: steps, survived: shares * steps, without: empty}
    figure, (left, right) = new_figure(1, 2, 10.0, 4.2)
    for axes in (left, right):
        default = scenario(2).curvature_floor
        axes.axvline(default, color="gray", linestyle=":", label="default floor")
    lines = {"step from the linear bound": steps, "step that survived": shares * steps}
    shown = {label: (floors, 1e6 * step) for label, step in lines.items()}
    looks = {"step that survived": {"marker": "s", "linestyle": "--"}}
    draw(left, shown, floor, "step [us]", "xy", "", looks, marker="o")
    draw(right, {without: (floors, 100 * empty)}, floor, f"{without} [%]", "x")
    caption = "Breakdown of the Frenet torsion, scenario 2"
    paper.report.figure("frenet_breakdown", figure, data, caption)
    whole = floors[shares == 1.0].min()
    paper.found["least curvature floor stable at its linear bound [1/m]"] = float(whole)


def _surviving(floor: float, duration: float) -> tuple[float, float, float, float, float]:
    """Scenario 2 with a curvature floor [1/m] over a time [s]: the floor, the step from the linear
    bound [s], the largest share of it, by halving, that was stable (0 = none), the energy error,
    and the mean share of samples with suppressed torsion."""
    scene = scenario(2, terms__twist="frenet", torsion__curvature_floor=floor)
    first = Simulator(at_method(scene, "velocity_verlet")).step
    share = 1.0
    while True:
        simulator = Simulator(at_method(scene, "velocity_verlet", share * first))
        fine, torsion = simulator.advance(duration).status.advanced, simulator.undefined_torsion
        if fine or share <= SMALLEST_SHARE:
            empty = torsion.mean / torsion.samples
            return floor, first, share * fine, simulator.energy_error, empty
        share *= 0.5


def _bend(scene: Scene, law: Law, quick: bool) -> tuple[Array, Array, int]:
    """Moments [N m] and mean curvatures [1/m] of a strip bent slowly to PEAK and released, and the
    number of loading steps."""
    simulator = Simulator(scene)
    knots = bspline.clamped_knots(scene.discretization.control_points, scene.cable.length)
    up = [law.moment(k) for k in np.linspace(0.0, PEAK, 17 if quick else 33)[1:]]
    moments = [*up, *np.linspace(up[-1], 0.0, 9)[1:]]
    curvature = []
    for moment in moments:
        simulator.set_load("tip", torque=(0.0, moment, 0.0))
        simulator.advance(6.0 if quick else 10.0)
        strain = elasticity.strains(simulator.control_points, knots, np.linspace(0.2, 0.8, 301))
        curvature.append(float(strain.binormal[:, 1].mean()))
    return np.array(moments), np.array(curvature), len(up)


def _plastic(paper: Paper) -> None:
    scene = scene_from_values(STRIP)
    law = Law(scene.cable.EI, scene.plasticity.yield_curvature, scene.plasticity.hardening)
    moments, curvature, loading = _bend(scene, law, paper.quick)
    dense = np.linspace(0.0, PEAK, 401)
    rising = np.interp(moments[:loading], [law.moment(k) for k in dense], dense)
    exact = np.concatenate([rising, law.set_after(PEAK) + moments[loading:] / law.EI])
    paper.found["plastic strip from the closed law / largest curvature"] = float(
        np.abs(curvature - exact).max() / PEAK
    )
    paper.found["set of the plastic strip / closed form"] = curvature[-1] / law.set_after(PEAK)
    simulated, closed = "simulated curvature [1/m]", "closed form [1/m]"
    data = {"moment [N m]": moments, simulated: curvature, closed: exact}
    figure, (axes,) = new_figure(width=8.5, height=4.6)
    axes.plot(moments, exact, color="black", label="closed form")
    lines = {"simulated curvature": (moments, curvature)}
    draw(axes, lines, "moment [N m]", "curvature [1/m]", marker="o", linestyle="")
    caption = "A clamped strip bent by a moment at its tip and released"
    paper.report.figure("moment_curvature", figure, data, caption)
