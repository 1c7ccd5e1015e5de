"""All terms of a scene as the methods take them: what one pass over the samples assembles, and the
terms that have a file of their own.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from dlo_sim.compiling.pieces import part
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
FLOWING = sum(term.bit for term in OPTIONAL if term.flow is not Term(0).flow)
T = TypeVar("T")


class Assembly(NamedTuple):
    """Functions of all terms, for the parts below: what every scene has, then one of each optional
    term.
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


@by_terms
def assembly(terms: int) -> Assembly:
    """The assembly of a scene with these bits."""
    found = [term if terms & term.bit else Term(term.bit) for term in OPTIONAL]
    return Assembly(
        forces=(forces, tuple(term.force for term in found)),
        energies=(energies, tuple(term.energy for term in found)),
        gradient=(
            discrete_force,
            tuple(term.gradient for term in found),
            tuple(term.damping for term in found),
        ),
        tangent=(
            add_tangent,
            tuple(term.tangent for term in found),
            tuple(term.damping_tangent for term in found),
        ),
        flow=tuple(term.flow for term in found),
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
