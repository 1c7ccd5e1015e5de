"""What the search for an equilibrium needs of the kernels: forces at rest, and a linear solver."""

from __future__ import annotations

from dlo_sim.kernels.forces import conservative_force, load_force
from dlo_sim.kernels.jit import entry
from dlo_sim.kernels.matrix import add_load_stiffness, eliminate, hold_prescribed, substitute

# The terms that `static_force` reads.
STATIC_TERMS = (
    *("lattice", "axes", "stretch", "span_stretch", "bend", "rest"),
    *("twist", "frenet", "plastic", "gravity", "springs", "loads"),
)


@entry
def static_force(x, terms, work, out):
    """Forces on the control points of a cable at rest at time zero, without the ends' reactions."""
    conservative_force(x, terms, work, out)
    load_force(x, terms.loads, terms.axes, 0.0, out)


@entry
def add_moment_stiffness(x, loads, axes, band):
    """Add the stiffness of moments, which turn with the cable, to the Hessian (unsymmetric)."""
    add_load_stiffness(x, loads, axes, 0.0, 1.0, band)


@entry
def solve_held(band, free, rhs):
    """Solve band x = rhs in place with prescribed DOFs held; (solved, number of negative pivots).

    For a symmetric matrix the number of negative pivots is that of its negative eigenvalues.
    """
    dim, n = free.shape
    half = 4 * dim - 1
    hold_prescribed(free, n, dim, band)
    if not eliminate(band, n * dim, half):
        return False, 0
    substitute(band, n * dim, half, rhs)
    negative = 0
    for r in range(n * dim):
        if band[r, half] < 0.0:
            negative += 1
    return True, negative
