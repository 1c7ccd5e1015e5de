"""MuJoCo on the tests of `study contact` that it can run: rod, lifted ends, capstans; `--peers`.

Error against run time of every model of MuJoCo with its settings, and the fastest setting of
dlo_sim whose error is not larger. MuJoCo is no dependency: it runs as a child process of the Python
interpreters that the user names (`contact_mujoco.py`).

Each test has variants (forces, lifts, coefficients of friction), and the error of a setting is the
largest of them, so that a setting is not judged by an error that happens to pass through zero.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dlo_sim.studies import PeerError, bodies
from dlo_sim.studies.known_answers import Answer, Measured
from dlo_sim.studies.report import Report

FORCES = (5.0, 8.0, 10.0)  # [N]
LIFTS = (3e-3, 4e-3, 5e-3)  # [m]; at 5 mm the exact answers, of small slopes, hold to 0.05 %
FRICTIONS = (0.2, 0.3, 0.4)
WORST = 0.05  # relative; a larger error is not an answer
REPEATS = 3
QUICK = 5  # settings of each model on a test in a quick study
TIMEOUT = 900.0  # [s] for all runs of a model on a test
SCRIPT = Path(__file__).with_name("contact_mujoco.py")
OLD, NEW = ("composite",), ("flex", "hinges")  # models of MuJoCo before version 4, and since
DEFAULT, HARD = "0.9 0.95 0.001", "0.99 0.9999 0.0001"  # solimp of MuJoCo, and a stiffer one
DEFAULT_TIME = 0.02  # [s], time constant of MuJoCo's contacts

Job = dict[str, Any]


class Peer(NamedTuple):
    """A Python interpreter and its version of MuJoCo."""

    python: str
    version: str

    @property
    def models(self) -> tuple[str, ...]:
        """The models of `contact_mujoco` that it has."""
        return OLD if int(self.version.partition(".")[0]) < 4 else NEW


def find(pythons: Iterable[str]) -> list[Peer]:
    """Interpreters with the MuJoCo that they have.

    Raises:
        PeerError: one cannot run, or has none; in one line with the cure.
    """
    found = []
    for python in pythons:
        code = "import mujoco; print(); print(mujoco.__version__)"
        try:
            done = subprocess.run([python, "-c", code], capture_output=True, text=True, timeout=60)
        except (OSError, subprocess.TimeoutExpired) as failure:
            raise PeerError(f"--peers {python}: {failure}; name a Python interpreter") from None
        if done.returncode:
            said = done.stderr.strip().rpartition("\n")[2] or f"exit status {done.returncode}"
            cure = f"run `{python} -m pip install mujoco`, or name a Python that has it"
            raise PeerError(f"--peers {python}: it cannot import mujoco ({said}); {cure}")
        found.append(Peer(python, done.stdout.split()[-1]))
    return found


def replies(
    python: str, command: Sequence[str], jobs: Sequence[Job]
) -> tuple[list[dict[str, Any]], str]:
    """Results of jobs that a script runs with its arguments, and what went wrong if there are
    fewer.
    """
    try:
        # MuJoCo writes a log to its working directory.
        with tempfile.TemporaryDirectory(prefix="dlo_sim_") as folder:
            done = subprocess.run(
                [python, *command],
                input=json.dumps(jobs),
                capture_output=True,
                text=True,
                timeout=TIMEOUT,
                cwd=folder,
                env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            )
    except (OSError, subprocess.TimeoutExpired) as failure:
        return [], type(failure).__name__
    # Libraries may print lines of their own.
    lines = [line for line in done.stdout.splitlines() if line.startswith('{"version"')]
    said = done.stderr.strip().splitlines()[-1:] or ["no answer"]
    return [json.loads(line) for line in lines], said[0] if len(lines) < len(jobs) else ""


class Run(NamedTuple):
    """A setting on a test: largest relative error of the variants, processor time [s] of all."""

    who: str
    words: str
    error: float
    seconds: float


class Test(NamedTuple):
    """A test of the study.

    Attributes:
        variants: as functions of control points and step, and as jobs without settings.
        points, steps: our settings. elements, peer_steps: of MuJoCo's implicit models; `composite`:
            steps [s] of the composite cable by number of elements. more: further choices of jobs.
    """

    name: str
    variants: Sequence[tuple[Callable[[int, float], Measured], Callable[[int], Job]]]
    points: tuple[int, ...]
    steps: tuple[float, ...]
    elements: tuple[int, ...]
    peer_steps: tuple[float, ...]
    composite: dict[int, float]
    more: dict[str, tuple[Any, ...]]


def rod(force: float, n: int) -> Job:
    """A rod that is pulled along a table for 1 s; see `bodies.sliding`."""
    stiffness = 1e7 * 0.05**2 / 16.0  # of the round section with this axial stiffness
    path = np.outer(np.arange(n + 1) / n, [1.0, 0.0, 0.0]) + [0.0, 0.0, 0.025]
    job = {"held": "free", "path": path.tolist(), "radius": 0.025, "mu": 1.0, "EI": stiffness}
    job |= {
        "gravity": bodies.ROD_GRAVITY,
        "friction": bodies.ROD_FRICTION,
        "force": [force, 0, 0],
    }
    return job | {"duration": 1.0, "settled": 0.5, "every": 1.0, "measured": "kinetic energy"}


def lying(clamped: bool, lift: float, n: int) -> Job:
    """A lying cable whose end is lifted within 0.5 s, 5.5 s later; see `bodies.lifted`."""
    link = 0.6 / (n - 0.5 * clamped)
    along = (np.arange(n + 1) - 0.5 * clamped) * link
    path = np.outer(along, [1.0, 0.0, 0.0]) + [0.0, 0.0, 0.0025]
    job = {"held": "clamped" if clamped else "pinned", "path": path.tolist(), "radius": 0.0025}
    job |= {"mu": bodies.WEIGHT / 9.81, "EI": bodies.EI, "gravity": 9.81}
    job |= {"velocity": [0.0, 0.0, lift / 0.5], "drawn": 0.5}
    return job | {"duration": 6.0, "settled": 5.5, "every": 0.1, "measured": "lift"}


def belt(wrap: float, friction: float, n: int) -> Job:
    """A cable drawn over a drum against 1 N; see `bodies.capstan`."""
    length, place = bodies.wound(wrap)
    path = np.array([place(u) for u in np.linspace(0.0, length, n + 1)])
    ways = np.diff(path, axis=0)
    ways *= (length / n / np.linalg.norm(ways, axis=1))[:, None]  # links of equal lengths
    path[1:] = path[0] + np.cumsum(ways, axis=0)
    pull = [math.cos(0.5 * wrap), 0.0, -math.sin(0.5 * wrap)]
    job = {"held": "pinned", "path": path.tolist(), "radius": bodies.THICK, "mu": 0.05, "EI": 1e-6}
    job |= {"gravity": 0.0, "friction": friction, "drum": bodies.DRUM, "force": pull}
    job |= {"velocity": [-0.02 * pull[0], 0.0, 0.02 * pull[2]], "drawn": 3.0}
    return job | {"duration": 3.0, "settled": 1.8, "every": 0.01, "measured": "pull"}


def all_tests() -> list[Test]:
    """The tests."""
    tests = [
        Test(
            name="sliding rod",
            variants=[(partial(_sliding, force), partial(rod, force)) for force in FORCES],
            points=(13,),
            steps=(1e-1, 5e-2, 2e-2, 1e-2),
            elements=(2, 5),
            peer_steps=(1e-2, 5e-3, 2e-3, 1e-3, 2e-4),
            composite={2: 1e-3, 5: 2e-4},
            more={
                "cone": ("elliptic", "pyramidal"),
                "impratio": (1.0, 10.0),
                "damping": (0.0,),
            },
        )
    ]
    for clamped, words in ((True, "lifted end, held"), (False, "lifted end, pinned")):
        tests.append(
            Test(
                name=words,
                variants=[
                    (partial(_lifted, clamped, lift), partial(lying, clamped, lift))
                    for lift in LIFTS
                ],
                points=(13, 16, 20, 30, 40),
                steps=(2.5e-1, 1e-1, 5e-2, 2e-2),
                elements=(10, 20, 40),
                peer_steps=(1e-1, 5e-2, 2e-2, 1e-2, 5e-3),
                composite={10: 1e-3, 20: 5e-4},
                more={"cone": ("pyramidal",), "impratio": (1.0,), "damping": (1e-3,)},
            )
        )
    for wrap, words in ((0.5 * math.pi, "capstan, pi/2"), (math.pi, "capstan, pi")):
        tests.append(
            Test(
                name=words,
                variants=[
                    (partial(_capstan, wrap, mu), partial(belt, wrap, mu)) for mu in FRICTIONS
                ],
                points=(17, 23, 33, 43),
                steps=(5e-2, 2e-2, 1e-2, 5e-3),
                elements=(20, 40, 80),
                peer_steps=(1e-2, 5e-3, 2e-3),
                composite={20: 1e-3},
                more={"cone": ("elliptic",), "impratio": (10.0,), "damping": (1.0, 10.0)},
            )
        )
    return tests


def _sliding(force: float, _points: int, step: float) -> Measured:
    return bodies.sliding(force, step)


def _lifted(clamped: bool, lift: float, points: int, step: float) -> Measured:
    return bodies.lifted(clamped, points, step, lift)


def _capstan(wrap: float, friction: float, points: int, step: float) -> Measured:
    return bodies.capstan(wrap, points, step=step, friction=friction)


def _forces(found: Measured) -> list[Answer]:
    """Answers that MuJoCo gives, too: of lifted ends from its contact forces."""
    ours_alone = "length [m]", "touch-down [N]"
    return [answer for answer in found.answers if answer.quantity not in ours_alone]


def own_runs(test: Test, quick: bool) -> list[Run]:
    """All our settings on a test."""
    runs = []
    for points, step in sample(list(product(test.points, test.steps)), quick):
        error, seconds = 0.0, 0.0
        for measure, _ in test.variants:
            repeats = [measure(points, step) for _ in range(REPEATS)]
            error = max(error, *(abs(answer.error) for answer in _forces(repeats[0])))
            seconds += min(one.seconds for one in repeats)
        words = f"{points} control points, {1e3 * step:g} ms"
        runs.append(Run("dlo_sim", words, error, seconds))
    return runs


def sample(choices: Sequence[Any], quick: bool) -> Sequence[Any]:
    """All settings, or for a quick study about QUICK, evenly among them."""
    return choices[:: math.ceil(len(choices) / QUICK)] if quick else choices


def settings(test: Test, model: str) -> Iterable[Job]:
    """The settings of a model. Contacts are as stiff as the step allows, or as MuJoCo's default."""
    kinds = list(product(test.elements, test.peer_steps))
    if model == "composite":
        kinds = list(test.composite.items())
    choices = [dict(zip(test.more, values, strict=True)) for values in product(*test.more.values())]
    for (n, step), impedance, choice in product(kinds, (DEFAULT, HARD), choices):
        for constant in sorted({2.0 * step, max(2.0 * step, DEFAULT_TIME)}):
            one = {"model": model, "n": n, "step": step, "impedance": impedance}
            yield one | {"time_constant": constant} | choice


def peer_runs(test: Test, peers: Sequence[Peer], quick: bool, absent: list[str]) -> list[Run]:
    """All models of MuJoCo on a test; what failed is added to `absent`."""
    exact = [[one.exact for one in _forces(measure(30, 1e-2))] for measure, _ in test.variants]
    common = {"drum": 0.0, "force": [0, 0, 0], "velocity": [0, 0, 0], "drawn": 0.0, "friction": 0.0}
    runs = []
    for peer, model in [(one, model) for one in peers for model in one.models]:
        tried = sample(list(settings(test, model)), quick)
        jobs = [
            {**common, **one, "repeats": REPEATS, "budget": 0.1, **variant(one["n"])}
            for one in tried
            for _, variant in test.variants
        ]
        for job in jobs:
            job["dimensions"] = 3 if job["friction"] else 1
            job["every"] = max(job["every"], job["step"])
        who = f"MuJoCo {peer.version}, {model}"
        answers, trouble = replies(peer.python, [str(SCRIPT)], jobs)
        absent += [f"{who} on {test.name}: {trouble}"] if trouble else []
        count, failed = len(test.variants), 0
        for k in range(len(answers) // count):
            some = answers[count * k : count * (k + 1)]
            if any(one["message"] for one in some):
                failed += 1
                continue
            error = max(
                abs(value / right - 1.0)
                for one, rights in zip(some, exact, strict=True)
                for value, right in zip(one["values"], rights, strict=True)
            )
            runs.append(Run(who, _words(tried[k]), error, sum(min(one["seconds"]) for one in some)))
        if failed:
            words = "settings are unstable or refused"
            absent.append(f"{who} on {test.name}: {failed} of {len(tried)} {words}")
    return runs


def _words(one: Job) -> str:
    words = f"{one['n']} elements, {1e3 * one['step']:g} ms, solref {one['time_constant']:g}, "
    words += f"solimp {one['impedance']}, {one['cone']} cone, impratio {one['impratio']:g}"
    return words + (f", damping {one['damping']:g} s" if one["damping"] else "")


def front(runs: Iterable[Run]) -> list[Run]:
    """The runs that no faster one surpasses in accuracy, fastest first."""
    best, found = WORST, []
    for run in sorted(runs, key=lambda run: run.seconds):
        if run.error <= best:
            best = 0.999 * run.error
            found.append(run)
    return found


def compare(
    report: Report,
    peers: Sequence[Peer],
    quick: bool,
    progress: Callable[[float], None] = lambda share: None,
) -> dict[str, str]:
    """Add a section to the report; returns the verdicts."""
    rows: list[list[Any]] = []
    points: list[tuple[str, str, float, float]] = []
    verdicts: dict[str, str] = {}
    absent: list[str] = []
    for number, test in enumerate(all_tests()):
        own, others = own_runs(test, quick), peer_runs(test, peers, quick, absent)
        lines = {who: front(run for run in others if run.who == who) for who in names(others)}
        lines["dlo_sim"] = front(own)
        points += [(test.name, who, run.seconds, run.error) for who in lines for run in lines[who]]
        ratios: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
        for run in (run for who in names(others) for run in lines[who]):
            equal = min(
                (one for one in own if one.error <= run.error),
                key=lambda one: one.seconds,
                default=None,
            )
            row: list[Any] = [None] * 4
            if equal:
                row = [equal.words, equal.error, equal.seconds, run.seconds / equal.seconds]
                hinged = run.who.endswith("hinges")
                if run in front(one for one in others if one.who.endswith("hinges") == hinged):
                    ratios[hinged].append((-run.error, row[-1]))
            rows.append([test.name, run.who, run.words, run.error, run.seconds, *row])
        for hinged, words in (
            (False, "the faster cable of MuJoCo"),
            (True, "a planar chain of hinges in MuJoCo"),
        ):
            if ratios[hinged]:
                found = [f"{ratio:.3g} at {-error:.2%}" for error, ratio in sorted(ratios[hinged])]
                verdicts[f"{test.name}, {words} takes times as long"] = ", ".join(found)
        finest = min(own, key=lambda one: one.error)
        verdicts[f"{test.name}, smallest error of dlo_sim"] = (
            f"{finest.error:.2g} in {finest.seconds:.2g} s"
        )
        progress((number + 1.0) / len(all_tests()))
    report.section("MuJoCo")
    report.text(
        f"""Error: largest over forces of {FORCES} N, lifts of {LIFTS} m or coefficients of friction
        {FRICTIONS}, and over the force and, of held ends, the moment. Run time: processor time of
        the steps of these three runs, each the least of up to {REPEATS}. Of each model of MuJoCo,
        the settings that no faster one surpasses, and the fastest setting of dlo_sim whose error is
        not larger. Errors above {WORST:.0%} are not shown."""
    )
    report.table(
        "contact_peers",
        "test | simulator | setting | error [%] | run time [ms] | dlo_sim within that error | "
        "its error [%] | its run time [ms] | times faster",
        rows,
        "MuJoCo, and the fastest dlo_sim setting whose error is not larger",
    )
    chart = "test | simulator | run time [s] | error [%]"
    whos = list(dict.fromkeys(who for _, who, *_ in points))
    looks = {who: {"color": f"C{k}"} for k, who in enumerate(whos)}
    caption = "Error against run time"
    report.chart("contact_peers_cost", chart, points, caption, log="xy", marker="o", looks=looks)
    report.text(*(f"Not measured: {line}" for line in absent))
    return verdicts


def names(runs: Iterable[Run]) -> list[str]:
    """Simulators of runs, each once."""
    return list(dict.fromkeys(run.who for run in runs))
