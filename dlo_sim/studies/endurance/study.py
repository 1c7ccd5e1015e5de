"""`dlo_sim study endurance`: long runs, invalid input, disturbances and overload."""

from __future__ import annotations

import importlib.util
import itertools
import json
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from dlo_sim.scene.loading import shipped_scene
from dlo_sim.studies.catalogue import Outcome, Request
from dlo_sim.studies.endurance import fuzz, soak
from dlo_sim.studies.endurance.bad_messages import messages
from dlo_sim.studies.endurance.live import CONTROL_POINTS, Case, Played, play, same_offline
from dlo_sim.studies.plotting import Panel, chart
from dlo_sim.studies.report import Report, columns

SEED = 1
PIECES = {  # numbers of random inputs
    True: {"messages": 4_000, "parameters": 200, "bags": 50, "signals": 20},
    False: {"messages": 100_000, "parameters": 10_000, "bags": 1_000, "signals": 1_000},
}
SOAK = {True: 40.0, False: 1800.0}  # [s]
ROUND = {True: 24.0, False: 60.0}  # [s], period of each disturbance
REST = 10.0  # [s] undisturbed at the end, for the comparison with offline
TIMED = {True: 8.0, False: 60.0}
LATENCIES = (0.001, 0.002, 0.003, 0.005, 0.008, 0.012, 0.06)
SWEPT = {True: 4.0, False: 15.0}
OVERLOAD = {True: (3.0, 12.0, 18.0), False: (5.0, 25.0, 75.0)}  # [s] begin, end, of the run
USUAL, OTHER = {"damping.air_drag": 0.005}, {"damping.air_drag": 0.006}
KINDS = ({"outputs.marker_rate": 20.0}, {"accuracy.estimate": "off"}, {"accuracy.estimate": "auto"})


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    files = {"two_grippers": shipped_scene("two_grippers")}
    report = Report(request.folder, "Endurance of session and node", request.command, files)
    verdicts = _fuzz(report, request.quick, request.part(0.0, 0.3))
    looks = soak.soaked(request.quick, request.part(0.3, 0.5))
    verdicts |= soak.describe(report, looks)
    if importlib.util.find_spec("rclpy") is None:
        report.text("The node was not run: rclpy is not installed.")
        verdicts["the node"] = "not run: rclpy is not installed"
    else:
        verdicts |= _live(report, request.quick, request.part(0.5, 1.0))
    return report.outcome(verdicts)


def _share(progress: Callable[[float], None], k: int, of: int) -> Callable[[float], None]:
    """Progress callback of part k of `of` equal parts."""
    return lambda fraction: progress((k + fraction) / of)


def _fuzz(report: Report, quick: bool, progress: Callable[[float], None]) -> dict[str, str]:
    counts, found = PIECES[quick], dict[str, Counter[str]]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parts = [_share(progress, k, 4) for k in range(4)]
        found["messages"] = messages(counts["messages"], SEED, parts[0])
        found["parameters"] = fuzz.parameters(counts["parameters"], SEED, parts[1])
        found["bags"] = fuzz.bags(counts["bags"], SEED, folder, parts[2])
        found["signals"] = fuzz.signals(counts["signals"], SEED, folder, parts[3])
    report.section("Random invalid input")
    report.text(
        """Messages of every type, three in four with non-finite numbers, wrong lengths, arbitrary
        stamps, flipped bits, truncated or extended; sets of random values for parameters of a
        running session; bags with changed bytes; SIGINT or SIGTERM to `simulate`, `replay` and
        `node` within their first 2.5 s. The study fails at the first input that raises, leads to a
        non-finite output, is refused in more than one line, or leaves an incomplete file."""
    )
    rows = [(what, *one) for what, made in found.items() for one in made.most_common()]
    report.table("fuzz", ["input", "outcome", "count"], rows, "Outcomes")
    total = ", ".join(f"{sum(made.values())} {what}" for what, made in found.items())
    return {"invalid input": f"{total}: none raised, each refusal one line"}


def soak_case(seconds: float, every: float) -> Case:
    """One parameter change per second; in each round a stop, a silent publisher, jumping stamps."""
    rounds = [every * k for k in range(int((seconds - REST) / every))]
    changes = [OTHER, *KINDS, USUAL]
    task = {
        "changes": [changes[k % len(changes)] for k in range(int(seconds - REST) - 3)]
        + [USUAL | {"accuracy.estimate": "auto", "outputs.marker_rate": 30.0}],
        "silences": [(at + 0.6 * every, at + 0.65 * every, "/dlo_sim/end/pose") for at in rounds]
        + [(seconds - REST, seconds - REST + 3.0, "")],
        "jumps": [(at + 0.8 * every, at + 0.9 * every, 3600.0) for at in rounds],
        "resets": [seconds - REST + 1.5],
    }
    stops = [(at + 0.3 * every, at + 0.3 * every + 1.5, 0.0, 0.0) for at in rounds]
    return Case(200.0, 13, seconds, task=task, stops=stops)


def rate_cases(seconds: float) -> dict[str, Case]:
    """The cases whose rates are measured."""
    return {
        "1 kHz, 13 control points": Case(1000.0, 13, seconds, 500.0, 500.0),
        "200 Hz, 50 control points": Case(200.0, 50, seconds),
        "the same beside a stopped reader": Case(200.0, 50, seconds, slow_reader=True),
    }


def latency_cases(seconds: float) -> dict[float, Case]:
    """Poses at 500 Hz, one case per latency."""
    values = {"accuracy.estimate": "off"}
    return {
        latency: Case(500.0, 13, seconds, 500.0, values={**values, "inputs.latency": latency})
        for latency in LATENCIES
    }


def overload_case(begin: float, end: float, seconds: float) -> Case:
    """For a while the process runs only 4 ms in 50; it would need a sixth of a core."""
    return Case(200.0, 50, seconds, stops=[(begin, end, 0.05, 0.92)])


def _live(report: Report, quick: bool, progress: Callable[[float], None]) -> dict[str, str]:
    rates, latencies = rate_cases(TIMED[quick]), latency_cases(SWEPT[quick])
    whole, runs = 2 + len(rates) + len(latencies), itertools.count()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def run(what: str, case: Case) -> Played:
            k = next(runs)
            domain = 1 + (os.getpid() + k) % 100
            return play(case, folder / what.replace(" ", "_"), domain, _share(progress, k, whole))

        verdicts = describe_soak(report, run("soak", soak_case(SOAK[quick], ROUND[quick])))
        verdicts |= describe_overload(report, run("overload", overload_case(*OVERLOAD[quick])))
        timed = {name: run(name, case) for name, case in rates.items()}
        verdicts |= describe_rates(report, timed)
        swept = {x: run(f"latency {x}", case) for x, case in latencies.items()}
        verdicts |= describe_latencies(report, swept)
    return verdicts


def describe_soak(report: Report, played: Played) -> dict[str, str]:
    """Add section, tables and figure of the live soak; returns the verdicts."""
    case, system = played.case, played.system.copy()
    equal, compared = same_offline(played)
    refused, other = _refused(played)
    taken, turned_down = played.source["changed"]
    report.section("The node, disturbed")
    report.text(
        f"""{case.seconds:.0f} s at {case.rate:.0f} Hz with two grippers at {case.poses:.0f} Hz and
        a wrench at {case.wrenches:.0f} Hz; one parameter is changed every second. In each round the
        process is stopped for 1.5 s, a publisher falls silent, and all stamps jump by an hour and
        back. At the end all publishers pause, `~/reset` is called, and the following states are
        compared with those of a session offline that gets the same messages."""
    )
    system[:, 2] *= 1e-6  # MB
    warm = len(system) // 5
    header = "sample | time [s] | processor [s] | resident [MB] | open files | threads"
    rows = [("after a fifth", *system[warm]), ("last", *system[-1])]
    report.table("node", header, rows, "The process")
    events = [(k, int(v)) for k, v in _counters(played) if int(v)]
    report.table("events", ["event", "count"], events, "Events counted in /diagnostics")
    data = {"time [s]": system[:, 0], "resident memory [MB]": system[:, 2]}
    panel = Panel("time [s]", "resident memory [MB]", ["resident memory [MB]"])
    chart(report, "node_memory", data, [panel], "Resident memory of the node", (8.0, 3.2))
    grown = (system[-1] - system[warm])[2:]
    return {
        f"{case.seconds:.0f} s live": (
            f"memory {grown[0]:+.2f} MB, files {grown[1]:+.0f}, threads {grown[2]:+.0f} after a "
            f"fifth; exit status {played.status}; {taken} changes accepted, {turned_down} refused; "
            f"{refused} messages refused, {other} of them not within 2 s of a jump"
        ),
        "live = offline afterwards": f"{equal} of {compared} states bitwise equal",
    }


def _counters(played: Played) -> Iterator[tuple[str, str]]:
    """Event and message counters in the last /diagnostics of the session."""
    last = json.loads(next(x for x in reversed(played.source["log"]) if ": session" in x))
    for key, value in last["/dlo_sim: session"].items():
        if key.startswith(("event ", "messages ")):
            yield key, value


def _refused(played: Played) -> tuple[int, int]:
    """Number of messages refused, and of those refused more than 2 s after a jump of the stamps."""
    jumps = played.case.task.get("jumps", ())
    edges = np.array([at for begin, end, _ in jumps for at in (begin, end)])  # type: ignore[attr-defined]
    total = other = 0
    for at, count in played.said("session", "messages refused"):
        near = len(edges) and np.any((at >= edges) & (at < edges + 2.0))
        other += 0 if near else int(count) - total
        total = int(count)
    return total, other


def describe_overload(report: Report, played: Played) -> dict[str, str]:
    """Add section, table and figure of the overload; returns the verdict."""
    stop = played.case.stops[0]
    begin, end, period, share = stop
    report.section("Too little processor time")
    report.text(
        f"""{played.case.n} control points at {played.case.rate:.0f} Hz; from {begin:.0f} to
        {end:.0f} s the process is stopped for {share:.0%} of each {period * 1e3:.0f} ms."""
    )
    names = ("markers_spared", "estimate_spared", "time_skipped", "taken_up")
    rows = []
    for name in names:
        seen = "0"
        for at, count in played.said("session", f"event {name}"):
            if count != seen:
                rows.append((at, name, int(count)))
            seen = count
    rows.sort(key=lambda row: row[0])  # stable: within a second in the order of `names`
    header = "time [s] {:.0f} | event in /diagnostics | count so far"
    report.table("shed", header, rows, "Load shed and resumed, to the second")
    lags = played.said("session", "lag [s]")
    data = {"time [s]": [at for at, _ in lags], "lag [s]": [float(lag) for _, lag in lags]}
    first = {name: next((at for at, what, _ in rows if what == name), None) for name in names}
    uprights = {name: at for name, at in first.items() if at is not None}
    panel = Panel("time [s]", "lag [s]", ["lag [s]"], uprights=uprights)
    caption = "Lag of the prediction, and the first time of each event"
    chart(report, "overload", data, [panel], caption, (8.0, 3.4))
    order = ", ".join(f"{name} after {at - begin:.0f} s" for at, name, _ in rows)
    return {"overload": order or "nothing was shed: the machine was fast enough"}


def describe_rates(report: Report, played: dict[str, Played]) -> dict[str, str]:
    """Add section and table of the rates; returns the verdicts."""
    report.section("Rates, measured in another process")
    report.text(
        f"""Poses, a wrench and all outputs; a third process publishes, a fourth subscribes. Age is
        arrival minus stamp of `~/control_points`; jitter is the deviation of the time between two
        arrivals from the period; late arrivals are more than 2.5 periods after the previous one;
        late ticks are counted by the node. Load average of the last minute:
        {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."""
    )
    rows, verdicts = [], {}
    for name, one in played.items():
        median, most = one.age
        above = median - one.case.scene.inputs.latency
        jitter = float(np.percentile(np.abs(one.gaps - 1.0 / one.case.rate), 99.0))
        late = one.count("node", "late ticks")
        arrivals = len(one.reader[CONTROL_POINTS])
        rows.append((name, median, most, above, jitter, arrivals, one.late, late, one.share))
        verdicts[name] = (
            f"age {median * 1e3:.1f} ms ({most * 1e3:.1f} for 99 %), {late} late ticks, "
            f"{one.share:.0%} of a core"
        )
    header = (
        "case | age [ms] | 99 % [ms] | above latency [ms] | jitter 99 % [ms] | arrivals | late | "
        "late ticks | share of a core"
    )
    report.table("rates", header, rows, "Age, jitter and cost")
    return verdicts


def describe_latencies(report: Report, played: dict[float, Played]) -> dict[str, str]:
    """Add section, table and figure of the latencies; returns the verdict."""
    report.section("Smallest useful inputs.latency")
    report.text(
        """Poses at 500 Hz, ticks at 500 Hz. Below some latency the next pose has not arrived when
        its state is due: the prediction waits for it, and the age decreases no further."""
    )
    rows = []
    for latency, one in played.items():
        median, most = one.age
        rows.append((latency, median, most, median - latency, one.count("session", "event late")))
    header = (
        "latency [ms] | age, median [ms] | age, 99 % [ms] | median above latency [ms] | "
        "late messages"
    )
    report.table("ages", header, rows, "Age of the outputs")
    axis = "inputs.latency [ms]"
    data = columns(("latency [s]", "median [s]", "99 % [s]"), [row[:3] for row in rows])
    panel = Panel("latency [s]", "age [ms]", ["median [s]", "99 % [s]"], x_axis=axis, log="xy")
    chart(report, "latencies", data, [panel], "Age of the outputs", (7.0, 4.0))
    useful = [latency for latency, _, _, above, late in rows if above <= 0.002 and not late]
    least = f"{min(useful) * 1e3:g} ms" if useful else "none of those tried"
    return {"smallest useful latency for 500 Hz poses": least}
