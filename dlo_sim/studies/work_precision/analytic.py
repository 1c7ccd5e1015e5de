"""Ours against what is known in closed form or by shooting: elastica, catenary, frequencies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from dlo_sim.core import mass, spectrum
from dlo_sim.kernels.instant import stiffness_band
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation import workspace
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import plotting
from dlo_sim.studies.catalogue import Request
from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.stability.truths import catenary
from dlo_sim.studies.work_precision import elastica
from dlo_sim.studies.work_precision.cases import CLOSED, cantilever, rod_of, soft_cable, steel, wire

Array = NDArray[np.float64]
RESOLUTIONS = {True: (7, 13), False: (7, 9, 13, 19, 27, 39)}
BETA_1, BETA_2 = 1.8751040687, 4.6940911330  # clamped-free beam: cos b cosh b = -1
METHOD = "energy_momentum"


def add(report: Report, request: Request) -> None:
    """Static shapes and frequencies against n_u: a table and a figure."""
    report.section("Against analytic results")
    known = [_cantilever(), _clamped(), _sag(), _catenary()]
    rows: list[list[Cell]] = []
    for name, scene, u, truth, scale in known:
        for n_u in RESOLUTIONS[request.quick]:
            placed = Simulator(at(scene, n_u))
            gap = placed.centerline([u * scene.cable.length])[0][[0, 2]] - truth
            off = float(np.abs(gap[np.isfinite(gap)]).max()) / scale
            rows.append([name, n_u, off])
    for n_u in RESOLUTIONS[request.quick]:
        for name, off in zip(("frequency 1", "frequency 2"), _frequencies(n_u), strict=True):
            rows.append([name, n_u, off])
    names = list(dict.fromkeys(str(row[0]) for row in rows))
    table: list[list[Cell]] = []
    for n_u in RESOLUTIONS[request.quick]:
        errors: list[Cell] = [100 * _number(r[2]) for r in rows if r[1] == n_u]
        table.append([n_u, *errors])
    report.table(
        "analytic",
        ["n_u", *(f"{name} [%]" for name in names)],
        table,
        "Errors of equilibria (of the length; the wire's of its sag) and natural frequencies",
    )
    report.text(
        """All elastica with the simulator's curvature, per deformed length; per rest length the
        cantilever's tip would be 0.02 % of its length away. Cantilever: the tip of the rubber cord
        under its weight, against the heavy elastica by shooting. Clamped: the middle of the soft
        cable with its grippers 0.8 m apart, likewise. Wire: its sag on its springs, likewise.
        Catenary: the middle of a cable without bending stiffness between two points, closed form.
        Frequencies 1 and 2 of the clamped-free steel wire without gravity: (beta_k / L)^2 sqrt(EI /
        mu), beta_k L = 1.8751, 4.6941."""
    )
    figure, (axes,) = plotting.new_figure(width=7.5, height=4.8)
    for name in names:
        shown = [row for row in rows if row[0] == name]
        x, y = [_number(r[1]) for r in shown], [100 * _number(r[2]) for r in shown]
        axes.loglog(x, y, "o-", label=name)
    axes.set(xlabel="control points n_u [-]", ylabel="error [%]")
    axes.set_xticks(RESOLUTIONS[request.quick], [str(n) for n in RESOLUTIONS[request.quick]])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.grid(alpha=0.3, which="both", linewidth=0.4)
    axes.legend(fontsize="small")
    report.figure(
        "analytic_errors",
        figure,
        {
            "what": np.array([str(row[0]) for row in rows]),
            "n_u": [_number(row[1]) for row in rows],
            "error [-]": [_number(row[2]) for row in rows],
        },
        "Equilibria and frequencies against analytic results",
    )


def at(scene: Scene, n_u: int) -> Scene:
    """The scene at rest with this resolution."""
    return scene.with_values(
        {
            "discretization.control_points": n_u,
            "discretization.quadrature": "gauss",
            "discretization.samples": 3,
            "integrator.method": METHOD,
            "integrator.step": 1e-3,
            "initial.shape": "equilibrium",
        }
    )


def model_rod(scene: Scene) -> elastica.Rod:
    """The cable's constants, with the simulator's own measure of curvature."""
    return replace(rod_of(scene), deformed=True)


Known = tuple[str, Scene, float, Array, float]


def _cantilever() -> Known:
    scene = cantilever().scene
    tip = elastica.cantilever_tip(model_rod(scene), scene.cable.length)
    return "cantilever", scene, 1.0, np.array(tip), scene.cable.length


def _clamped() -> Known:
    gap = 1.0 - CLOSED
    scene = soft_cable().scene.with_values({"end.position": [gap, 0.0, 0.0]})
    sag = elastica.clamped_sag(model_rod(scene), scene.cable.length, gap)
    return "clamped", scene, 0.5, np.array([0.5 * gap, -sag]), scene.cable.length


def _sag() -> Known:
    scene = wire(1).scene
    sag = elastica.wire_sag(model_rod(scene), scene.cable.length, scene.start.spring[0])
    return "wire", scene, 0.5, np.array([0.5 * scene.cable.length, -sag]), sag


def _catenary() -> Known:
    scene = scene_from_values(
        {
            "cable.linear_density": 0.1,
            "cable.axial_stiffness": 1.0e4,
            "terms.bend": "off",
            "end.position": [0.8, 0.0, 0.0],
            "end.fixed": [True] * 3,
        }
    )
    length = scene.cable.length
    x, z = catenary(np.array([0.5 * length]), length, 0.8, 0.1 * 9.81, 1.0e4)
    return "catenary", scene, 0.5, np.array([float(x[0]), float(z[0])]), length


def _frequencies(n_u: int) -> tuple[float, float]:
    """Relative errors of the two lowest bending frequencies of the steel wire."""
    scene = at(steel().scene, n_u).with_values(
        {"gravity": [0.0, 0.0, 0.0], "initial.shape": "straight"}
    )
    simulator = Simulator(scene)
    model = simulator.model
    state, work = workspace.new_state(model), workspace.new_work(model)
    solver = workspace.new_solver(model)
    state.position[:, : model.n] = model.to_rows(simulator.control_points)
    stiffness_band(state.position, model.stiffness_terms, model.viscosity, work, solver)
    dim = len(model.axes)
    free = np.flatnonzero(model.terms.mass.free[1, : model.n])
    across = dim * free + 1  # z: the second row of the plane
    k = spectrum.dense(solver.band)[np.ix_(across, across)]
    m = mass.dense(model.terms.mass.band[1])[np.ix_(free, free)]
    factor = np.linalg.inv(np.linalg.cholesky(m))
    omega = np.sqrt(np.linalg.eigvalsh(factor @ k @ factor.T)[:2])
    cable = scene.cable
    exact = np.array([BETA_1, BETA_2]) ** 2 / cable.length**2 * np.sqrt(cable.EI / cable.mu)
    off = np.abs(omega / exact - 1.0)
    return float(off[0]), float(off[1])


def _number(cell: Cell) -> float:
    assert isinstance(cell, int | float)
    return float(cell)
