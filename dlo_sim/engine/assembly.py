"""Forces, energies and Jacobians of a scene, as the methods call them: the basic terms and the
optional ones.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from dlo_sim.compiling.pieces import Piece, part
from dlo_sim.engine import bishop, contact, drag, layout, natural_curvature, plasticity, torsion
from dlo_sim.engine.discrete import discrete_force
from dlo_sim.engine.forces import energies, forces
from dlo_sim.engine.tangent import add_tangent
from dlo_sim.engine.term import Term

OPTIONAL = (
    natural_curvature.TERM,
    torsion.TERM,
    bishop.TERM,
    plasticity.TERM,
    contact.TERM,
    drag.TERM,
)
"""The optional terms; a new one is added here."""


BITS = functools.reduce(operator.or_, (term.bit for term in OPTIONAL), layout.TWISTED)
NO_TERM = Term(0)
FLOWING = sum(term.bit for term in OPTIONAL if term.flow is not NO_TERM.flow)
T = TypeVar("T")


class Assembly(NamedTuple):
    """Functions of all terms, for the parts below: first those of the basic terms, then a tuple
    with those of the optional terms. Compiled tuples start with their length (`pieces.code_of`).
    """

    forces: Any
    energies: Any
    gradient: Any
    tangent: Any
    flow: Any


def by_terms(make: Callable[[int], T]) -> Callable[[int], T]:
    """Cache a function of the bits of the terms; scenes that agree in BITS share a result."""
    made = functools.lru_cache(make)
    return lambda terms: made(int(terms) & BITS)


def _functions(name: str, terms: int) -> tuple[Piece, ...]:
    """The function of this name of every term that has one, empty for terms not in these bits."""
    empty = getattr(NO_TERM, name)
    having = [term for term in OPTIONAL if getattr(term, name) is not empty]
    return tuple(getattr(term, name) if terms & term.bit else empty for term in having)


@by_terms
def assembly(terms: int) -> Assembly:
    """The assembly of a scene with these bits."""
    of = functools.partial(_functions, terms=terms)
    return Assembly(
        forces=(forces, of("force")),
        energies=(energies, of("energy")),
        gradient=(discrete_force, of("gradient"), of("damping")),
        tangent=(add_tangent, of("tangent"), of("damping_tangent")),
        flow=of("flow"),
    )


ANY = assembly(0)
"""Its type, the same for all scenes, appears in signatures."""


@part
def all_forces(assembled, shape, model, state, x, out):
    """out = - dU/dq of all terms."""
    _, forces, others = assembled
    forces(shape, model, state, x, out)
    for add in others[1:]:
        add(shape, model, state, x, x, out)


@part
def all_energies(assembled, shape, model, state, x, out):
    """Potential energies [J] of all terms into `out`, as `forces.energies`."""
    _, energies, others = assembled
    energies(shape, model, state, x, out)
    for add in others[1:]:
        add(shape, model, state, x, out)


@part
def discrete_gradient(assembled, shape, model, state, x0, x1, moved, viscous, out, lost):
    """out -= discrete gradient between x0 and x1, and viscous forces (`discrete_force`)."""
    _, discrete_force, others, _ = assembled
    discrete_force(shape, model, state, x0, x1, moved, viscous, out, lost)
    for add in others[1:]:
        add(shape, model, state, x0, x1, out)


@part
def add_damping(assembled, shape, model, x, moved, scale, out):
    """out -= scale C(x) moved of the optional terms; `assembled`: Assembly.gradient."""
    _, _, _, others = assembled
    for add in others[1:]:
        add(shape, model, x, moved, scale, out)


@part
def add_damping_tangent(assembled, shape, model, x, scale, scratch, band):
    """band += scale C(x) of the optional terms; `assembled`: Assembly.tangent."""
    _, _, _, others = assembled
    for add in others[1:]:
        add(shape, model, x, scale, scratch, band)


@part
def all_tangents(assembled, shape, model, state, x0, x1, viscous, scale, scratch, band):
    """band += scale times the Jacobian of the discrete gradient, of all terms (`add_tangent`)."""
    _, add_tangent, others, _ = assembled
    add_tangent(shape, model, state, x0, x1, viscous, scale, scratch, band)
    for add in others[1:]:
        add(shape, model, state, x0, x1, scale, scratch, band)


@part
def flow(flows, shape, model, inputs, state, scratch):
    """Update the internal variables of the terms at the end of a step. Return whether that may
    change the forces, so that the next step must evaluate them again.
    """
    for change in flows[1:]:
        change(shape, model, inputs, state, scratch)
    return shape[layout.TERMS] & FLOWING != 0
