"""The motion in both scenarios: the paper's figures of control points and shapes."""

from __future__ import annotations

import numpy as np

from dlo_sim.studies.paper.wires import SCENARIOS, Paper, scenario
from dlo_sim.studies.report import curves
from dlo_sim.studies.runs import at_method, distance, each, run

DURATION = {True: 2.0, False: 10.0}  # [s]
EVERY = 0.005  # [s] between samples
SHAPES = 12  # of the cable in a figure
START = 1.0  # [s], start of the motion shown enlarged
OTHERS = ("rk4", "velocity_verlet")  # whose runs of scenario 2 are compared with Forest-Ruth's
APART = 1e-3  # [m]
PLANE = "largest |y| in scenario 1, computed in space [m]"
MIRRORED = "largest difference of mirrored z / sag, scenario 1"
COORDINATES = {1: "xz", 2: "xyz"}  # in which the control points of a scenario move


def add(paper: Paper) -> None:
    """Run both scenarios with Forest-Ruth and add their figures."""
    paper.report.text(
        """Forest-Ruth at its own step; x is drawn as the displacement from the start. Scenario 2 is
        chaotic: differences of the size of round-off between two fourth-order methods grow
        exponentially, so later positions are one of many equally valid motions, whatever the
        integrator; then mirrored control points diverge too."""
    )
    spatial = scenario(1, terms__out_of_plane="on")
    wanted = [(number, "forest_ruth") for number in SCENARIOS] + [(2, m) for m in OTHERS]
    cases = [(at_method(scenario(k), m), DURATION[paper.quick], EVERY) for k, m in wanted]
    cases.append((at_method(spatial, "forest_ruth"), START, EVERY))
    first, second, *others, in_space = each(paper.workers, run, cases).values()
    for number, recording in ((1, first), (2, second)):
        where, time = SCENARIOS[number], recording.time
        moved = recording.control_points[:, :, :3].copy()
        moved[:, :, 0] -= moved[0, :, 0]
        for name in COORDINATES[number]:
            every = {f"q{q + 1}": y for q, y in enumerate(moved[:, :, "xyz".index(name)].T)}
            rows = curves(time, every, "whole run")
            rows += curves(time[time <= START], every, f"first {START:g} s")
            header = f"shown | control point | time [s] | {name} [mm]"
            caption = f"{name} of every control point, {where}"
            paper.report.chart(f"scenario_{number}_{name}", header, rows, caption)
        shapes = [
            (f"t = {time[k]:.2f} s", *place)
            for k in np.linspace(0, len(time) - 1, SHAPES).astype(int)
            for place in recording.centerline[k][:, [0, 2]]
        ]
        header, caption = "time | x [m] | z [mm]", f"Sequence of shapes, {where}"
        paper.report.chart(f"scenario_{number}_shapes", header, shapes, caption)
    gaps = {m: distance(one, second) for m, one in zip(OTHERS, others, strict=True)}
    lines = curves(second.time[1:], {method: gap[1:] for method, gap in gaps.items()})
    header = "method | time [s] | largest distance from forest_ruth [m]"
    caption = "Two methods in scenario 2, each at 0.9 of its stability limit"
    paper.report.chart("scenario_2_parting", header, lines, caption, "y")
    far = np.flatnonzero(gaps["rk4"] > APART)
    apart = float(second.time[far[0]]) if far.size else float("inf")
    paper.found["two methods 1 mm apart in scenario 2 from [s]"] = apart
    z = first.control_points[:, :, 2]
    sag = -float(first.centerline[:, :, 2].min())
    paper.found["largest sag, scenario 1 [mm]"] = 1e3 * sag
    paper.found[MIRRORED] = float(np.abs(z - z[:, ::-1]).max() / sag)
    paper.found[PLANE] = float(np.abs(in_space.control_points[:, :, 1]).max())
