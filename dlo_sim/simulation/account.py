"""The energy account of a run, seen from outside the step."""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels import layout
from dlo_sim.kernels.observe import kinetic_energy, potentials, start_account
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.model import Model

CREEP = 1e-6  # of the length per second: motion slower than that exchanges no energy


def open_account(scene: Scene, model: Model, state: layout.State, work: layout.Work) -> None:
    """Begin the account at the present state."""
    cable = scene.cable
    state.ledger[:] = 0.0
    state.ledger[layout.FLOOR] = 0.5 * cable.mu * cable.length * (CREEP * cable.length) ** 2
    parts = potentials(state.position, model.terms, work)
    kinetic = kinetic_energy(state.w, model.terms.mass, model.n)
    start_account(state, model.account_terms, work, parts, kinetic)


def balance(model: Model, state: layout.State, work: layout.Work) -> tuple[float, float]:
    """|energy - work done + energy lost| [J] now, and the largest energy exchanged so far [J]."""
    ledger = state.ledger
    kinetic = kinetic_energy(state.w, model.terms.mass, model.n)
    parts = np.array(potentials(state.position, model.terms, work))
    start = ledger[layout.POTENTIAL_START : layout.POTENTIAL_START + len(parts)]
    works = ledger[layout.LOAD_WORK], ledger[layout.DRIVE_WORK]
    error = kinetic + float(parts.sum()) - ledger[layout.ENERGY_START] - sum(works)
    error += ledger[layout.DISSIPATED] - ledger[layout.PENDING]
    largest = float(np.abs(parts - start).max())
    return abs(error), max(ledger[layout.EXCHANGED], kinetic, largest, *np.abs(works))


def share_open(model: Model, state: layout.State, work: layout.Work) -> float:
    """|energy - work done + energy lost| as a share of the energy exchanged so far."""
    error, exchanged = balance(model, state, work)
    return error / max(exchanged, float(state.ledger[layout.FLOOR]))
