"""The work-precision diagram: settings tried on every case, error and time from the same run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from dlo_sim.core.methods import CONSTRAINED, IMPLICIT, METHODS
from dlo_sim.scene.loading import SceneError
from dlo_sim.studies import plotting
from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.work_precision.cases import Case
from dlo_sim.studies.work_precision.peers.runs import PeerRun
from dlo_sim.studies.work_precision.references import Reference
from dlo_sim.tuning.setting import Setting
from dlo_sim.tuning.trial import Trial, at_share, attempt, error

Array = NDArray[np.float64]
LEVELS = (10.0, 3.0, 1.0, 0.3, 0.1, 0.03)  # [%]
PAPER_STEP = 2e-3  # [s], which no explicit method bears on the wire
BEYOND = 1.2  # share of its own step at which an explicit method must be refused


@dataclass(frozen=True)
class Grid:
    """What is tried: methods, those implicit ones that are tried with stretching by span as well,
    resolutions, steps of implicit methods [s], shares of own steps of explicit and of constrained
    ones, and how long repeats take [s]."""

    methods: tuple[str, ...]
    by_span: tuple[str, ...]
    control_points: tuple[int, ...]
    steps: tuple[float, ...]
    shares: tuple[float, ...]
    constrained_shares: tuple[float, ...]
    budget: float


FULL = Grid(
    methods=(
        *("forest_ruth", "rk4", "velocity_verlet", "rattle"),
        *("implicit_midpoint", "energy_momentum", "energy_momentum_4", "generalized_alpha"),
    ),
    by_span=("energy_momentum", "energy_momentum_4", "generalized_alpha"),
    control_points=(7, 9, 11, 13, 17, 23),
    steps=(1e-2, 5e-3, 2e-3, 1e-3, 5e-4),
    shares=(1.0, 0.5),
    constrained_shares=(1.0, 0.5, 0.25),
    budget=0.1,
)
QUICK = Grid(
    methods=("velocity_verlet", "rattle", "energy_momentum"),
    by_span=("energy_momentum",),
    control_points=(7, 11),
    steps=(5e-3, 2e-3),
    shares=(1.0,),
    constrained_shares=(1.0,),
    budget=0.02,
)


@dataclass(frozen=True, eq=False)
class Point:
    """A trial on a case and its error as a share of the case's scale; infinite if it failed."""

    case: Case
    trial: Trial
    error: float

    @property
    def setting(self) -> Setting:
        """What was tried."""
        return self.trial.setting

    @property
    def way(self) -> str:
        """Where stretching counts, as a word."""
        method = METHODS[self.setting.method]
        return "left out" if method.family == CONSTRAINED else f"by {self.setting.stretch}"

    @property
    def evaluations(self) -> float:
        """Force evaluations, or Newton iterations, per simulated second."""
        return self.trial.force_evaluations / max(self.trial.steps * self.trial.step, 1e-300)


def tried(case: Case, truth: Reference, setting: Setting, budget: float) -> Point:
    """A setting tried on a case and judged."""
    trial = attempt(case.job, setting, budget=budget)
    off = error(trial.points, truth.points, case.components) / case.scale
    return Point(case, trial, off)


def swept(
    case: Case,
    truth: Reference,
    grid: Grid,
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[Point]:
    """All settings of a grid on a case."""
    points = []
    kinds = list(product(grid.methods, grid.control_points))
    for k, (method, n_u) in enumerate(kinds):
        for setting in _settings(case, grid, method, n_u):
            points.append(tried(case, truth, setting, grid.budget))
        progress((k + 1) / len(kinds))
    return points


def _settings(case: Case, grid: Grid, method: str, n_u: int) -> list[Setting]:
    if METHODS[method].family == IMPLICIT:
        ways = ("sample", "span") if method in grid.by_span else ("sample",)
        return [Setting(method, n_u, step, stretch=way) for way in ways for step in grid.steps]
    first = Setting(method, n_u)
    constrained = METHODS[method].family == CONSTRAINED
    shares = grid.constrained_shares if constrained else grid.shares
    try:
        found = [at_share(case.job, first, share) for share in shares]
    except SceneError:
        return [first]
    if method == "velocity_verlet" and n_u == grid.control_points[0]:
        found.append(Setting(method, n_u, PAPER_STEP))
    if method == "rattle":
        found.append(Setting(method, n_u, found[0].step * BEYOND))
    return found


def best(points: list[Point], level: float) -> Point | None:
    """The fastest of those whose error is at most `level` (a share)."""
    good = [p for p in points if p.trial.ok and p.error <= level]
    return min(good, key=lambda p: p.trial.wall) if good else None


def add(
    report: Report,
    case: Case,
    truth: Reference,
    points: list[Point],
    peers: list[PeerRun],
) -> None:
    """A case's diagram, the fastest setting for each error level, and every run."""
    report.section(case.title, 3)
    report.text(
        f"""Error: rms over {case.job.duration:g} s of {_axes(case)} at
        {", ".join(f"{u:g} L" for u in case.job.u)}, in % of {case.scale_words}
        ({case.scale:.4g} m). Reference: {truth.setting.method}, n_u
        {truth.setting.control_points}, step {1e6 * truth.step:.3g} us; its own error is
        {100 * truth.space:.2g} % in space (against n_u {case.fine[0]}) and {100 * truth.time:.2g} %
        in time (half the step), so nothing below {100 * truth.own_error:.2g} % is told apart."""
    )
    _figure(report, case, truth, points, peers)
    report.table(
        f"fastest_{case.name}",
        ["error at most [%]", "setting", "error [%]", "s per simulated s", "spread", "steps/s"],
        [_level_row(points, level, truth) for level in LEVELS],
        f"{case.title}: the fastest setting for each error level",
    )
    report.table(
        f"runs_{case.name}",
        [
            *("method", "stretch", "n_u", "step [ms]", "status", "error [%]"),
            *("s per simulated s", "spread", "evaluations/s", "energy error"),
        ],
        [
            [
                p.setting.method,
                p.way,
                p.setting.control_points,
                1e3 * p.trial.step,
                p.trial.status,
                100 * p.error if p.trial.ok else None,
                p.trial.wall if p.trial.ok else None,
                f"{100 * p.trial.spread:.0f} %" if p.trial.ok else None,
                p.evaluations if p.trial.ok else None,
                p.trial.energy_error if p.trial.ok else None,
            ]
            for p in points
        ]
        + [_peer_row(p) for p in peers],
        f"{case.title}: every run; failed ones too. Of other simulators n_u is the number of "
        "elements",
    )


def _peer_row(p: PeerRun) -> list[Cell]:
    timed = np.isfinite(p.wall)
    return [
        *(p.peer, None, p.elements, 1e3 * p.step, p.status),
        100 * p.error if p.ok else None,
        p.wall if timed else None,
        f"{100 * p.spread:.0f} %" if timed else None,
        *(None, None),
    ]


def _axes(case: Case) -> str:
    names = ["xyz"[axis] for axis in case.components]
    return names[0] if len(names) == 1 else f"the worse of {' and '.join(names)}"


def _level_row(points: list[Point], level: float, truth: Reference) -> list[Cell]:
    found = best(points, level / 100.0)
    if level / 100.0 < truth.own_error:
        return [level, "below the reference's own error", None, None, None, None]
    if found is None:
        return [level, "none of those tried", None, None, None, None]
    trial = found.trial
    return [
        level,
        trial.setting.words,
        100 * found.error,
        trial.wall,
        f"{100 * trial.spread:.0f} %",
        1.0 / trial.step,
    ]


def _figure(
    report: Report, case: Case, truth: Reference, points: list[Point], peers: list[PeerRun]
) -> None:
    figure, axes = plotting.new_figure(1, 2, width=12.0, height=5.4)
    good = [p for p in points if p.trial.ok]
    failed = [p for p in points if not p.trial.ok]
    ways: list[tuple[str, Callable[[Point], float]]] = [
        ("run time [s per simulated s]", lambda p: p.trial.wall),
        (
            "force evaluations (implicit: Newton iterations) per simulated s",
            lambda p: p.evaluations,
        ),
    ]
    for panel, (label, cost) in zip(axes, ways, strict=True):
        for setting in dict.fromkeys(replace(p.setting, step=0.0) for p in good):
            row = [p for p in good if replace(p.setting, step=0.0) == setting]
            row.sort(key=cost)
            x, y = [cost(p) for p in row], [100 * p.error for p in row]
            panel.plot(
                x, y, linewidth=0.9, markersize=3.5, **_look(setting.method, setting.stretch)
            )
            name = str(setting.control_points)
            panel.annotate(name, (x[-1], y[-1]), (4, -2), textcoords="offset points", fontsize=7)
        panel.axhline(100 * truth.own_error, color="0.5", linestyle=":", linewidth=1.0)
        panel.set(xscale="log", yscale="log", xlabel=label)
        panel.xaxis.set_minor_formatter(NullFormatter())
        panel.set_ylabel(f"error [% of {case.scale_words}]")
        panel.grid(alpha=0.3, which="both", linewidth=0.4)
    _peer_marks(axes[0], peers)
    _failed_marks(axes[0], failed)
    for method, way in dict.fromkeys((p.setting.method, p.setting.stretch) for p in points):
        name = f"{method}, stretch by span" if way == "span" else method
        axes[1].plot([], [], label=name, markersize=4, **_look(method, way))
    axes[1].plot([], [], "k:", label="own error of the reference")
    if failed:
        axes[1].plot([], [], "kx", label=f"failed or refused ({len(failed)})")
    # One legend for both panels, outside: inside it would lie on the fastest runs.
    ours, others = axes[1].get_legend_handles_labels(), axes[0].get_legend_handles_labels()
    axes[1].legend(
        ours[0] + others[0],
        ours[1] + others[1],
        fontsize="small",
        loc="center left",
        bbox_to_anchor=(1.01, 0.5),
    )
    figure.suptitle(f"{case.title} (numbers: n_u, at the smallest step; a line: one resolution)")
    report.figure(
        f"work_precision_{case.name}",
        figure,
        {
            "method": np.array(
                [p.setting.method for p in points] + [p.peer for p in peers], dtype=str
            ),
            "stretch": np.array([p.way for p in points] + [""] * len(peers)),
            "n_u": [p.setting.control_points for p in points] + [p.elements for p in peers],
            "step [s]": [p.trial.step for p in points] + [p.step for p in peers],
            "status": np.array([p.trial.status for p in points] + [p.status for p in peers]),
            "error [%]": [100 * p.error for p in points] + [100 * p.error for p in peers],
            "run time [s per simulated s]": [p.trial.wall for p in points]
            + [p.wall for p in peers],
            "evaluations [1/s]": [p.evaluations for p in points] + [np.nan] * len(peers),
        },
        f"{case.title}: error against run time and against force evaluations",
    )


def _look(method: str, stretch: str) -> dict[str, Any]:
    """Colour of the method; dashed and open where stretching counts by span."""
    by_span = stretch == "span"
    return {
        "color": plotting.COLORS.get(method, "black"),
        "marker": "o",
        "linestyle": "--" if by_span else "-",
        "fillstyle": "none" if by_span else "full",
    }


def _peer_marks(panel: plotting.Axes, peers: list[PeerRun]) -> None:
    for name, marker in zip(dict.fromkeys(p.peer for p in peers), "sD^v<>", strict=False):
        own = [p for p in peers if p.peer == name]
        row = [p for p in own if p.ok and np.isfinite(p.error)]
        without = len(own) - len(row)
        panel.plot(
            [p.wall for p in row],
            [100 * p.error for p in row],
            marker,
            color="black",
            fillstyle="none",
            label=f"{name} ({without} without a result)" if without else name,
        )


def _failed_marks(panel: plotting.Axes, failed: list[Point]) -> None:
    """Failed runs have neither time nor error: crosses along the upper edge, in their order."""
    place = np.linspace(0.03, 0.97, max(len(failed), 2))
    for x, p in zip(place, failed, strict=False):
        color = plotting.COLORS.get(p.setting.method, "black")
        panel.plot([x], [0.985], "x", color=color, transform=panel.transAxes, markersize=5)
