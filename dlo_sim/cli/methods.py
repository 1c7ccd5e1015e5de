"""`dlo_sim methods`: the time integrators, as their own descriptions have them."""

import argparse
import dataclasses
from collections.abc import Callable

from dlo_sim.cli.arguments import Parser
from dlo_sim.cli.output import print_json
from dlo_sim.core.methods import IMPLICIT, METHODS, Method

_YES_NO = ("no", "yes")
_COLUMNS: dict[str, Callable[[Method], str]] = {
    "method": lambda one: one.name,
    "order": lambda one: str(one.order),
    "symmetric": lambda one: _YES_NO[one.symmetric],
    "symplectic": lambda one: _YES_NO[one.symplectic],
    "conserves energy": lambda one: _YES_NO[one.conserves_energy],
    "forces/step": lambda one: "solver" if one.family == IMPLICIT else str(one.force_evaluations),
    "limit": lambda one: f"{one.stability_limit:g}".replace("inf", "none"),
    "damping": lambda one: (
        ", ".join(kind for kind in ("mass", "stiffness") if getattr(one, f"{kind}_damping"))
        or "none"
    ),
    "source": lambda one: one.source,
}
HELP = "list the time integration methods"


def add_arguments(parser: Parser) -> None:
    """Say what the subcommand does and takes."""
    parser.description = (
        "List the methods for integrator.method: order, whether they are symmetric and "
        "symplectic and conserve energy, force evaluations per step, largest stable omega tau, the "
        "damping for which they are valid, and their source."
    )


def run(options: argparse.Namespace) -> int:
    """Print the methods; returns the exit status."""
    if options.json:
        # force_evaluations is 0 where a solver decides.
        facts = [
            dataclasses.asdict(one) | {"force_evaluations": one.force_evaluations}
            for one in METHODS.values()
        ]
        print_json({"methods": facts})
        return 0
    columns = [[name, *map(cell, METHODS.values())] for name, cell in _COLUMNS.items()]
    padded = [[cell.ljust(max(map(len, column))) for cell in column] for column in columns]
    for row in zip(*padded, strict=True):
        print("  ".join(row).rstrip())
    return 0
