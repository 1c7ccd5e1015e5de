"""The one loop in which a cable is stepped, sampled, watched and judged.

`play` runs a simulator, and stops where a timeline changes something or a watcher looks. Between
two stops is a `stretch`: motions that have waited begin in it, and the cable is looked at for
buckling and for passing through itself, at steps that depend on their number only, so that the
division of a run into calls changes nothing. At its end shape and energy are judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from dlo_sim.core.methods import IMPLICIT
from dlo_sim.simulation import remarks
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import WRONG, Report, Status, explained, newton_note
from dlo_sim.simulation.running import Running
from dlo_sim.simulation.soundness import judged, sound_now
from dlo_sim.simulation.stepper import AS_BEFORE, CHUNK, Along


class Played(Protocol):
    """What `play` asks of a simulator."""

    steps: int

    def advance_steps(self, steps: int, recorder: Recorder | None = None) -> Report:
        """Advance by whole steps."""


class Timeline(Protocol):
    """Changes of a cable at certain steps of a run."""

    def apply(self, stop: int) -> int:
        """Make the changes that are due; returns the step, at most `stop`, of the next ones. If it
        is the present step, the run ends.
        """


class Watcher(Protocol):
    """Looks at a run, and may end it."""

    def next_look(self, steps: int) -> int:
        """The first step after `steps` at which it has to look."""

    def look(self, report: Report) -> str:
        """Look at the state at a stop; report: of the stretch before. Returns why the run has to
        end, one line; empty: it goes on.
        """


def play(
    simulator: Played,
    until: int,
    recorder: Recorder | None = None,
    timeline: Timeline | None = None,
    watchers: Sequence[Watcher] = (),
) -> Report:
    """Run a simulator up to step number `until`; if it is there already, it is only judged.

    Returns:
        The report of all steps, with status, message and note of the last stretch; UNRESOLVED if a
        recorded shape is no cable's.
    """
    total = Report(Status.OK, "", 0, 0.0, 0)
    while True:
        stop = min([until, *(one.next_look(simulator.steps) for one in watchers)])
        if timeline is not None:
            stop = timeline.apply(stop)
            if stop == simulator.steps < until:
                return total
        last = simulator.advance_steps(stop - simulator.steps, recorder)
        total = last.after(total)
        ends = [why for one in watchers if (why := one.look(last))]
        if simulator.steps >= until or not last.status.advanced:
            return total if recorder is None else judged(total, recorder)
        if ends:
            return total._replace(status=Status.INTERRUPTED, message=ends[0])


def stretch(
    sim: Running, steps: int, recorder: Recorder | None = None, along: Along = AS_BEFORE
) -> Report:
    """Advance by whole steps between two stops of `play`. On failure the last good state is kept.

    Args:
        along: separate motions of the end effectors for every step.
    """
    method, step, done, evaluations = sim.choice.method, sim.choice.step, 0, 0
    while done < steps:
        most = min(CHUNK, steps - done, sim.steps_of_motions)
        piece = remarks.steps_until_look(sim, most)
        ahead = along if along is AS_BEFORE else along.part(done, piece)
        status, made, used, worst = sim.stepper.advance(sim.steps, piece, recorder, ahead)
        sim.steps += made
        done, evaluations = done + made, evaluations + used
        if made:
            remarks.look_for_buckling(sim)
        if done >= steps or done // CHUNK > (done - made) // CHUNK or not status.ok:
            remarks.look_at_itself(sim)
        sim.begin_motions()
        if not status.ok:
            message = (
                f"{explained(status, method)} (at {sim.time:.6g} s, "
                f"{sim.model.place_of(worst)}; method {method.name}, step {step:g} s)"
            )
            return Report(status, message, done, done * step, evaluations)
    note = newton_note(method, step, done, evaluations, sim.scene.touches)
    wrong = sound_now(sim.cable, sim.ends, sim.time)
    if not wrong and method.family != IMPLICIT and sim.energy_error > WRONG:
        wrong = remarks.open_balance(sim)
    status = Status.UNRESOLVED if wrong else Status.OK
    return Report(status, wrong, done, done * step, evaluations, note)
