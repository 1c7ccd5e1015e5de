"""`dlo_sim methods`: the time integrators, as their own descriptions have them."""

import argparse
import dataclasses
import math
from typing import Any

from dlo_sim.cli.arguments import Parser
from dlo_sim.cli.output import print_json
from dlo_sim.core.methods import IMPLICIT, METHODS, Method

_HEADER = (
    *("method", "order", "symmetric", "symplectic", "conserves energy", "forces/step", "limit"),
    *("damping", "source"),
)

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
        print_json({"methods": [_facts(method) for method in METHODS.values()]})
        return 0
    rows = [_HEADER, *(_row(method) for method in METHODS.values())]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEADER))]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        print("  ".join(cells).rstrip())
    return 0


def _facts(method: Method) -> dict[str, Any]:
    """Everything about a method; force_evaluations is 0 where a solver decides."""
    return dataclasses.asdict(method) | {"force_evaluations": method.force_evaluations}


def _row(method: Method) -> tuple[str, ...]:
    damping = [kind for kind in ("mass", "stiffness") if getattr(method, f"{kind}_damping")]
    implicit = method.family == IMPLICIT
    return (
        method.name,
        str(method.order),
        "yes" if method.symmetric else "no",
        "yes" if method.symplectic else "no",
        "yes" if method.conserves_energy else "no",
        "solver" if implicit else str(method.force_evaluations),
        "none" if math.isinf(method.stability_limit) else f"{method.stability_limit:g}",
        ", ".join(damping) or "none",
        method.source,
    )
