"""All terms of a scene as the methods take them: what one pass over the samples assembles, and the
terms that have a file of their own.
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
"""The terms that a scene may lack; a new one is added here."""


BITS = functools.reduce(operator.or_, (term.bit for term in OPTIONAL), layout.TWISTED)
NO_TERM = Term(0)
FLOWING = sum(term.bit for term in OPTIONAL if term.flow is not NO_TERM.flow)
T = TypeVar("T")


class Assembly(NamedTuple):
    """Functions of all terms, for the parts below: what every scene has, then that of each optional
    term that supplies one.
    """

    forces: Any
    energies: Any
    gradient: Any
    tangent: Any
    flow: Any


def by_terms(make: Callable[[int], T]) -> Callable[[int], T]:
    """What is made from the bits of the terms, once for all scenes that agree in those of BITS."""
    made = functools.lru_cache(make)
    return lambda terms: made(int(terms) & BITS)


def _functions(name: str, terms: int) -> tuple[Piece, ...]:
    """This function of every term that supplies it; of those not in these bits, the empty one."""
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
"""Of the type of all others, for signatures."""


@part
def all_forces(assembled, shape, model, state, x, out):
    """out = - dU/dq of everything that has a potential."""
    _, forces, others = assembled
    forces(shape, model, state, x, out)
    for add in others[1:]:
        add(shape, model, state, x, x, out)


@part
def all_energies(assembled, shape, model, state, x, out):
    """Potential energies [J] by term (`layout.ENERGIES`) as rows of `out`; then the sum of the
    sizes of the weight's parts.
    """
    _, energies, others = assembled
    energies(shape, model, state, x, out)
    for add in others[1:]:
        add(shape, model, state, x, out)


@part
def discrete_gradient(assembled, shape, model, state, x0, x1, moved, viscous, out, lost):
    """out -= discrete gradient between x0 and x1, and viscous stresses (`discrete_force`)."""
    _, discrete_force, others, _ = assembled
    discrete_force(shape, model, state, x0, x1, moved, viscous, out, lost)
    for add in others[1:]:
        add(shape, model, state, x0, x1, out)


@part
def add_damping(assembled, shape, model, x, moved, scale, out):
    """out -= scale C(x) moved of the optional terms, from the functions of the gradient."""
    _, _, _, others = assembled
    for add in others[1:]:
        add(shape, model, x, moved, scale, out)


@part
def add_damping_tangent(assembled, shape, model, x, scale, scratch, band):
    """band += scale C(x) of the optional terms, from the functions of the tangent."""
    _, _, _, others = assembled
    for add in others[1:]:
        add(shape, model, x, scale, scratch, band)


@part
def all_tangents(assembled, shape, model, state, x0, x1, viscous, scale, scratch, band):
    """band += scale times the Jacobian of the discrete gradient by x1 (`add_tangent`)."""
    _, add_tangent, others, _ = assembled
    add_tangent(shape, model, state, x0, x1, viscous, scale, scratch, band)
    for add in others[1:]:
        add(shape, model, state, x0, x1, scale, scratch, band)


@part
def flow(flows, shape, model, inputs, state, scratch):
    """Change of the terms' own state at the shape after a step; whether that changes forces. Then
    the next step computes them anew, as it would after a pause between two calls.
    """
    for change in flows[1:]:
        change(shape, model, inputs, state, scratch)
    return shape[layout.TERMS] & FLOWING != 0
