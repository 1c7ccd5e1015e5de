"""Static shapes against closed forms or numerical solutions: elastica, catenary."""

from __future__ import annotations

from itertools import product

import numpy as np

from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.plotting import Panel, chart
from dlo_sim.studies.report import Report, columns
from dlo_sim.studies.runs import Array
from dlo_sim.studies.stability.scenes import ends
from dlo_sim.studies.stability.truths import catenary
from dlo_sim.studies.work_precision import elastica
from dlo_sim.studies.work_precision.cases import CLOSED, cantilever, rod_of, soft_cable, wire

RESOLUTIONS = {True: (7, 13), False: (7, 9, 13, 19, 27, 39)}
Known = tuple[Scene, float, Array, float]  # scene, u / L, its x and z there [m], scale [m]


def add(report: Report, quick: bool) -> None:
    """Add a table and a figure of the errors of static shapes against n_u."""
    report.section("Against analytic results")
    report.text(
        """Compared with the heavy elastica, solved by collocation, with curvature per deformed
        length as in the simulator (per rest length the cantilever's tip would differ by 0.02 % of
        the length): cantilever, the tip of the rubber cord; clamped, the middle of the soft cable
        with its grippers 0.8 m apart; wire, its sag on its springs. Catenary: the middle of a cable
        without bending stiffness, closed form. Errors are relative to the length, for the wire to
        its sag."""
    )
    shapes = known()
    rows = []
    for (name, (scene, u, truth, scale)), n_u in product(shapes.items(), RESOLUTIONS[quick]):
        place = Simulator(at(scene, n_u)).centerline([u * scene.cable.length])[0, [0, 2]]
        rows.append((name, n_u, float(np.abs(place - truth).max()) / scale))
    report.table(
        "analytic",
        ["n_u", *(f"{name} [%]" for name in shapes)],
        [[n_u, *(row[2] for row in rows if row[1] == n_u)] for n_u in RESOLUTIONS[quick]],
        "Errors of equilibria",
    )
    data = columns(("what", "n_u", "error"), rows)
    panel = Panel("n_u", "error [%]", ["error"], by="what", log="y", marker="o")
    chart(report, "analytic_errors", data, [panel], "Equilibria against analytic results")


def at(scene: Scene, n_u: int) -> Scene:
    """The scene at rest with this resolution."""
    return scene.with_values(
        {
            "discretization.control_points": n_u,
            "discretization.quadrature": "gauss",
            "discretization.samples": 3,
            "integrator.method": "energy_momentum",
            "integrator.step": 1e-3,
            "initial.shape": "equilibrium",
        }
    )


def known() -> dict[str, Known]:
    """Static shapes with known solutions, by name."""
    cord, thin, gap = cantilever().scene, wire(1).scene, 1.0 - CLOSED
    soft = soft_cable().scene.with_values({"end.position": [gap, 0.0, 0.0]})
    tip = elastica.cantilever_tip(rod_of(cord, True), cord.cable.length)
    length = thin.cable.length
    sag = elastica.sag(rod_of(thin, True), length, length, thin.start.spring[0])
    low = elastica.sag(rod_of(soft, True), soft.cable.length, gap)
    cable = {"cable.linear_density": 0.1, "cable.axial_stiffness": 1.0e4, "terms.bend": "off"}
    limp = scene_from_values({**cable, **ends(0.0, gap)})
    length = limp.cable.length
    (x,), (z,) = catenary(np.array([0.5 * length]), length, gap, 0.1 * 9.81, 1.0e4)
    return {
        "cantilever": (cord, 1.0, np.array(tip), cord.cable.length),
        "clamped": (soft, 0.5, np.array([0.5 * gap, -low]), soft.cable.length),
        "wire": (thin, 0.5, np.array([0.5 * thin.cable.length, -sag]), sag),
        "catenary": (limp, 0.5, np.array([x, z]), length),
    }
