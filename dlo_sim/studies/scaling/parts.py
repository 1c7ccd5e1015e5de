"""Time and operations of the parts of a step, against what the core can do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dlo_sim.core.methods import METHODS
from dlo_sim.simulation import workspace
from dlo_sim.studies import plotting
from dlo_sim.studies.arithmetic import multiply_add_rate, operations
from dlo_sim.studies.report import Report
from dlo_sim.studies.scaling import passes
from dlo_sim.studies.scaling.wire import SAMPLES_PER_SPAN, moving
from dlo_sim.studies.stopwatch import Cost, least, step_cost

SIZES = {True: (9, 40, 400), False: (9, 40, 400)}
REPEATS = {True: 15, False: 60}
PIECE = 0.002  # [s] of one timed piece
COUNTED = (11, 19)  # control points whose spans fill the vector lanes exactly
EXPLICIT, WHOLE_STEP = "explicit force", "explicit step, forest_ruth"
IMPLICIT = ("implicit force", "Jacobian", "assembly", "factors", "solution")
ITERATION = "implicit iteration, the sum"
STEPS_BEFORE = 10  # of 2 ms, until the wire is bent and moving


@dataclass(frozen=True)
class Part:
    """A part of a step.

    Attributes:
        source: its kernel. loop: the entry that repeats it, called with the same arguments and the
            number of times. arguments: of both.
    """

    source: Callable[..., object]
    loop: Callable[..., object]
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class Measured:
    """Time and operations of a part at one size; bound: operations per second of the core [1/s]."""

    part: str
    size: int
    operations: int
    cost: Cost
    bound: float

    @property
    def samples(self) -> int:
        """Quadrature points."""
        return SAMPLES_PER_SPAN * (self.size - 3)

    @property
    def rate(self) -> float:
        """Operations per second [1/s]."""
        return self.operations / self.cost.best

    @property
    def share(self) -> float:
        """Of the bound [-]."""
        return self.rate / self.bound


def parts(size: int) -> dict[str, Part]:
    """The parts of a step of the moving wire with so many control points, ready to be called."""
    simulator = moving(size, "energy_momentum")
    simulator.advance_steps(STEPS_BEFORE)
    model = simulator.model
    terms, friction, viscosity = model.terms, model.friction, model.viscosity
    x, work = workspace.new_state(model).position, workspace.new_work(model)
    solver = workspace.new_solver(model)
    x[:, :size] = model.to_rows(simulator.control_points)
    force = (x, terms, viscosity, work, solver)
    passes.repeat_implicit_gradient(*force, 1)
    solver.p0[:] = solver.p1
    simulator.advance_steps(1)
    x[:, :size] = model.to_rows(simulator.control_points)
    passes.repeat_implicit_gradient(*force, 1)
    passes.repeat_implicit_jacobian(terms, viscosity, solver, 1)
    passes.repeat_assembled_matrix(terms, friction, solver, 1)
    # Each part has what it reads to itself: the factors would otherwise overwrite the matrix.
    matrix, factored = solver.band.copy(), solver._replace(band=solver.band.copy())
    factored.rhs[:] = work.force[: len(model.axes), :size].T.ravel()
    passes.repeat_factors(terms, matrix, factored, 1)
    return {
        EXPLICIT: Part(passes.explicit_gradient, passes.repeat_explicit_gradient, (x, terms, work)),
        IMPLICIT[0]: Part(passes.implicit_gradient, passes.repeat_implicit_gradient, force),
        IMPLICIT[1]: Part(
            passes.implicit_jacobian, passes.repeat_implicit_jacobian, (terms, viscosity, solver)
        ),
        IMPLICIT[2]: Part(
            passes.assembled_matrix, passes.repeat_assembled_matrix, (terms, friction, solver)
        ),
        IMPLICIT[3]: Part(passes.factors, passes.repeat_factors, (terms, matrix, factored)),
        IMPLICIT[4]: Part(passes.solution, passes.repeat_solution, (terms, factored)),
    }


def counted() -> dict[str, tuple[int, int]]:
    """Operations of every part as (a, b): a + b n_u without any padding of the vector lanes."""
    few, many = ({name: _count(part) for name, part in parts(n).items()} for n in COUNTED)
    lines = {}
    for name in few:
        each = (many[name] - few[name]) // (COUNTED[1] - COUNTED[0])
        lines[name] = (few[name] - each * COUNTED[0], each)
    return lines


def _count(part: Part) -> int:
    return operations(part.source, *part.arguments)


def measured(quick: bool, progress: Callable[[float], None]) -> list[Measured]:
    """Every part at every size, and the sums that make a step and an iteration."""
    lines = counted()
    rates = [multiply_add_rate()]
    timed: list[tuple[str, int, int, Cost]] = []
    evaluations = METHODS["forest_ruth"].force_evaluations
    for size in SIZES[quick]:
        done = {name: a + b * size for name, (a, b) in lines.items()}
        costs = {name: _cost(part, REPEATS[quick]) for name, part in parts(size).items()}
        timed += [(name, size, done[name], costs[name]) for name in costs]
        step = step_cost(moving(size, "forest_ruth"), PIECE, REPEATS[quick])
        timed.append((WHOLE_STEP, size, evaluations * done[EXPLICIT], step))
        best, median = (
            sum(getattr(costs[name], which) for name in IMPLICIT) for which in ("best", "median")
        )
        timed.append((ITERATION, size, sum(done[name] for name in IMPLICIT), Cost(best, median)))
        rates.append(multiply_add_rate())
        progress(len(rates) / (len(SIZES[quick]) + 1))
    return [Measured(*row, max(rates)) for row in timed]


def _cost(part: Part, repeats: int) -> Cost:
    """Time of one pass, in pieces of about `PIECE`."""
    once = least(lambda: part.loop(*part.arguments, 20), 3, 20).best
    times = max(20, int(PIECE / once))
    return least(lambda: part.loop(*part.arguments, times), repeats, times)


def describe(report: Report, found: list[Measured]) -> dict[str, str]:
    """Section, table and figure; returns the verdicts."""
    bound = found[0].bound
    report.section("Parts of a step against the bound of the core")
    report.text(
        f"""The bound is a plain loop of fused multiply-adds on one core, each two operations:
        {1e-9 * bound:.1f} Gflop/s, the best of several times in the same run. Operations are
        counted by running the kernels' own source on numbers that count (add, multiply, divide and
        square root are one each), for {COUNTED[0]} and {COUNTED[1]} control points, where the spans
        fill the vector lanes; the line through the two, a + b n_u, holds for every size, and leaves
        out what lanes without a span do. An expression that is written twice counts twice, so a
        share can be flattered by what the compiler computes once. A sample is a quadrature point,
        {SAMPLES_PER_SPAN} per span.""",
        f"""*{EXPLICIT}* is control points to spans, gradient at the samples, and back.
        *{IMPLICIT[0]}* is the same with the discrete gradient, *{IMPLICIT[1]}* its derivative per
        span, *{IMPLICIT[2]}* the band matrix from it, *{IMPLICIT[3]}* its LU factors (with a copy
        of the matrix), *{IMPLICIT[4]}* one solution with them; an iteration that keeps the matrix
        of an earlier one has only the first and the last. *{WHOLE_STEP}* is a step as it is run, of
        which only the operations of its forces count as work.""",
    )
    report.table(
        "parts",
        [
            *("part", "n_u", "operations", "operations per sample", "time [us]", "spread"),
            *("Gflop/s", "bound [Gflop/s]", "share of the bound"),
        ],
        [
            [
                one.part,
                one.size,
                one.operations,
                one.operations / one.samples,
                1e6 * one.cost.best,
                f"{100 * one.cost.spread:.0f} %",
                1e-9 * one.rate,
                1e-9 * one.bound,
                f"{100 * one.share:.0f} %",
            ]
            for one in found
        ],
        "Parts of a step: operations, time, and share of what the core can do",
    )
    _figure(report, found)
    return {
        f"share of the arithmetic bound, {name}": ", ".join(
            f"{100 * one.share:.0f} % at n_u = {one.size}" for one in found if one.part == name
        )
        for name in (EXPLICIT, ITERATION)
    }


def _figure(report: Report, found: list[Measured]) -> None:
    figure, (axes,) = plotting.new_figure(width=9.0, height=5.0)
    names = list(dict.fromkeys(one.part for one in found))
    sizes = list(dict.fromkeys(one.size for one in found))
    place = np.arange(len(names))[::-1].astype(float)
    thick = 0.8 / len(sizes)
    for k, size in enumerate(sizes):
        shares = [100 * one.share for one in found if one.size == size]
        at = place + 0.4 - (k + 0.5) * thick
        axes.barh(at, shares, 0.9 * thick, label=f"n_u = {size}")
    axes.set_yticks(place, names)
    axes.set(xlim=(0.0, 100.0), xlabel="share of the multiply-add rate of one core [%]")
    axes.grid(alpha=0.3, axis="x")
    axes.legend(fontsize="small")
    report.figure(
        "share_of_the_bound",
        figure,
        {
            "part": np.array([one.part for one in found]),
            "n_u": [one.size for one in found],
            "operations": [one.operations for one in found],
            "time [s]": [one.cost.best for one in found],
            "bound [1/s]": [one.bound for one in found],
        },
        "How near the parts of a step come to the arithmetic bound of one core",
    )
