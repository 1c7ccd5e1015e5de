"""The claims of the paper: section, quotation, criterion and verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from dlo_sim.studies.paper import accuracy, energy, limits, motion, timing
from dlo_sim.studies.paper.limits import PLAIN, TORSION
from dlo_sim.studies.paper.published import CONTROL_POINTS, REFERENCE
from dlo_sim.studies.paper.wires import COMPARED
from dlo_sim.studies.report import Report, shown

Found = Mapping[str, float]
INTEGRATOR, RESULTS, CONCLUSIONS = "Symplectic Integrator", "Simulation Results", "Conclusions"
COARSER = [n for n in CONTROL_POINTS if n != REFERENCE[0]]
NOTICEABLE = 5.0  # [%], change of an error that is visible in a plot
SMALL = 10.0  # [%], small compared with the effect of n_u
NEAR = 0.98  # share of the largest error that counts as equal to it
FASTER = 0.8  # share of the other's time below which a method counts as faster


class Claim(NamedTuple):
    """A claim: section and words in the paper, the condition on the findings under which it holds,
    the names of the findings, the decisive one first, the tables and figures with the evidence, and
    the condition under which it holds in part.
    """

    name: str
    section: str
    words: str
    holds: Callable[[Found], bool]
    measured: tuple[str, ...]
    shown: tuple[str, ...]
    partly: Callable[[Found], bool] = lambda found: False


def judge(report: Report, found: Found) -> list[dict[str, Any]]:
    """Add the table of claims; returns each with its verdict and findings."""
    judged = []
    for claim in CLAIMS:
        partly = "holds in part" if claim.partly(found) else "does not hold"
        measured = {name: float(found[name]) for name in claim.measured}
        judged.append(
            {
                "name": claim.name,
                "section": claim.section,
                "words": claim.words,
                "verdict": "holds" if claim.holds(found) else partly,
                "measured": measured,
                "shown": claim.shown,
            }
        )
    rows = [
        (
            *(one["name"], one["section"], f'"{one["words"]}"', f"**{one['verdict']}**"),
            *(evidence(one), ", ".join(f"`{name}`" for name in one["shown"])),
        )
        for one in judged
    ]
    header = "claim | section | in the paper's words | verdict | measured | shown in"
    caption = "The claims of the paper, their sections, and the results of this run"
    report.table("claims", header, rows, caption)
    return judged


def evidence(claim: Mapping[str, Any]) -> str:
    """The findings of a judged claim as text."""
    return "; ".join(f"{name}: {shown(value)}" for name, value in claim["measured"].items())


def _stuck(found: Found) -> int:
    """Number of methods that are stopped in scenario 2; 0 if Forest-Ruth is stopped too."""
    forest_ruth, *others = (found[limits.STOPPED(PLAIN, m)] for m in ("forest_ruth", "rk4", "zhai"))
    return 0 if forest_ruth else sum(map(bool, others))


def _gains(found: Found) -> int:
    """Number of comparisons in which Forest-Ruth takes clearly less time than RK4."""
    cost, _, slower = (found[name] for name in accuracy.BESIDE_RK4)
    shares = (cost, 1.0 / slower, found[timing.TIME("forest_ruth")] / found[timing.TIME("rk4")])
    return sum(share < FASTER for share in shares)


def _drifts(found: Found, method: str) -> bool:
    return abs(found[energy.ADDED(method)]) > 3.0 * found[energy.SWING(method)]


CLAIMS = (
    Claim(
        "2 ms is the largest stable step",
        RESULTS,
        "This time step-size is the largest value that preserves the stability",
        lambda f: 0.9 < f[limits.RATIO] < 1.1,
        (limits.RATIO, limits.LIMIT("forest_ruth", 1), *limits.AT_2_MS),
        ("stable_steps", "limit_by_term", "paper_step"),
    ),
    Claim(
        "25 % less time than Runge-Kutta",
        INTEGRATOR,
        "the CPU time can be decreased by approximately 25 percent",
        lambda f: _gains(f) == 3,
        (*accuracy.BESIDE_RK4, timing.TIME("forest_ruth"), timing.TIME("rk4")),
        ("cost_per_step", "time_at_equal_error", "table_3"),
        partly=lambda f: _gains(f) > 0,
    ),
    Claim(
        "the symplectic method is the fastest",
        CONCLUSIONS,
        "the symplectic integrator is the fastest",
        lambda f: f[timing.TIME("forest_ruth")] <= min(f[timing.TIME(m)] for m in COMPARED),
        tuple(map(timing.TIME, COMPARED)),
        ("table_3", "run_time", "work_precision"),
    ),
    Claim(
        "the symplectic method is the most stable",
        CONCLUSIONS,
        "and the most stable integrator among the considered ones",
        lambda f: f[limits.LIMIT("forest_ruth", 1)] >= max(f[limits.LIMIT(m, 1)] for m in COMPARED),
        tuple(limits.LIMIT(m, 1) for m in COMPARED),
        ("stable_steps", "stable_steps_chart"),
    ),
    Claim(
        "Runge-Kutta and Zhai are stuck in scenario 2",
        RESULTS,
        "the Runge-Kutta and Zhai integrators have been stuck and could not compute any solution",
        lambda f: _stuck(f) == 2,
        (
            *(limits.LIMIT(m, 2) for m in ("rk4", "zhai", "forest_ruth")),
            *(limits.STOPPED(PLAIN, m) for m in ("rk4", "zhai")),
            *(limits.STOPPED(TORSION, m) for m in ("forest_ruth", "rk4", "zhai")),
        ),
        ("stable_steps", "torsion_at_paper_step", "table_4"),
        partly=lambda f: _stuck(f) > 0,
    ),
    Claim(
        "Zhai is the slowest",
        RESULTS,
        "the Zhai integrator is excluded as it is the slowest",
        lambda f: f[timing.COST("zhai")] >= max(f[timing.COST(m)] for m in COMPARED),
        (
            *map(timing.COST, ("zhai", "forest_ruth")),
            *(limits.LIMIT(m, 1) for m in ("zhai", "forest_ruth")),
            "Zhai's positions from Verlet's [m]",
        ),
        ("cost_per_step", "stable_steps"),
    ),
    Claim(
        "no secular energy error",
        INTEGRATOR,
        "the aggregation of the truncation error in the total energy has not a secular component",
        lambda f: not _drifts(f, "forest_ruth") and _drifts(f, "rk4"),
        (
            *(name(m) for m in ("forest_ruth", "rk4") for name in (energy.ADDED, energy.SWING)),
            *(energy.LARGEST(m) for m in ("forest_ruth", "rk4")),
        ),
        ("energy_regular", "energy_regular_chart", "energy_real"),
        partly=lambda f: True,
    ),
    Claim(
        "position errors grow linearly, others' quadratically",
        INTEGRATOR,
        "the positional errors rise in proportional to the first order of time ... conventional "
        "integrators ... with the square of time",
        lambda f: f[energy.EXPONENT("forest_ruth")] < 1.3 and f[energy.EXPONENT("rk4")] > 1.7,
        (
            *(name(m) for name in (energy.EXPONENT, energy.LAST) for m in ("forest_ruth", "rk4")),
            *(energy.BEHIND, *energy.REAL_EXPONENTS),
        ),
        ("energy_regular", "error_growth", "energy_real"),
        partly=lambda f: f[energy.EXPONENT("forest_ruth")] < 1.3,
    ),
    Claim(
        "n_s has no noticeable effect",
        RESULTS,
        "n_s has no noticeable effect on the error",
        lambda f: max(f[accuracy.CHANGE(51, n)] for n in COARSER) < NOTICEABLE,
        (accuracy.CHANGE(51, 9), *(accuracy.CHANGE(81, n) for n in COARSER)),
        ("error_by_size", "error_over_samples_and_points"),
        # Without the smallest n_s, at the paper's own n_u.
        partly=lambda f: f[accuracy.CHANGE(81, 9)] < SMALL,
    ),
    Claim(
        "the error falls with n_u",
        RESULTS,
        "As n_u increases, the error decreases and vice versa",
        lambda f: all(
            f[accuracy.ERROR(fine)] < f[accuracy.ERROR(coarse)]
            for coarse, fine in zip(COARSER, COARSER[1:], strict=False)
        ),
        (*map(accuracy.ERROR, COARSER), "rms error of the reference itself [mm]"),
        ("error_by_size", "error_over_time", "error_over_length"),
        partly=lambda f: f[accuracy.ERROR(13)] < f[accuracy.ERROR(9)] < f[accuracy.ERROR(5)],
    ),
    Claim(
        "fewer control points or samples take less time",
        RESULTS,
        "reducing n_u and/or n_s will require less execution time",
        lambda f: f[timing.SAMPLES_COST] > 1.0 and f[timing.POINTS_COST] > 1.0 - NOTICEABLE / 100.0,
        (
            *(timing.POINTS_COST, timing.SAMPLES_COST),
            *map(timing.SIZE_COST, CONTROL_POINTS),
            *(timing.RUN(n) for n in (5, 19)),
        ),
        ("table_7", "stable_sweep", "cost_over_size"),
        partly=lambda f: f[timing.SAMPLES_COST] > 1.0,
    ),
    Claim(
        "the error is largest at the centre",
        RESULTS,
        "the maximum error occurred at the center of the DLO",
        lambda f: min(f[accuracy.CENTRE(n)] for n in COARSER) > NEAR,
        tuple(map(accuracy.CENTRE, (9, *(n for n in COARSER if n != 9)))),
        ("error_over_length", "error_over_time_and_length"),
        partly=lambda f: f[accuracy.CENTRE(9)] > NEAR,
    ),
    Claim(
        "the error decreases over time",
        RESULTS,
        "the error decreases over time",
        lambda f: f[accuracy.LATE] < 0.8 * f[accuracy.EARLY],
        (accuracy.LATE, accuracy.EARLY),
        ("error_over_time", "error_over_time_and_length"),
    ),
    Claim(
        "C++ is three times as fast as MATLAB",
        CONCLUSIONS,
        "C++ is about three times faster than the corresponding MATLAB implementation",
        lambda f: 2.0 < f[timing.RATIO] < 4.5,
        (timing.RATIO, "MATLAB / C++ time of the paper"),
        ("cost_per_step",),
    ),
    Claim(
        "in scenario 1 y is zero and mirrored points coincide",
        RESULTS,
        "the y component for each control point is equal to zero ... each two control points' "
        "trajectories are located above each other",
        lambda f: f[motion.PLANE] == 0.0 and f[motion.MIRRORED] < 1e-6,
        (motion.MIRRORED, motion.PLANE),
        ("scenario_1_z",),
        partly=lambda f: True,
    ),
)
