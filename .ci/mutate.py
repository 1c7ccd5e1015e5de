"""Do the tests see a mistake in the physics? One mutation at a time, in a copy of the checkout.

python .ci/mutate.py COUNT [--seed N] mutates so many places of `terms`, `engine` and `methods`,
drawn at random: a sign is flipped, a factor changed, a statement left out. It prints each with what
caught it and the share caught so far, at last the survivors. What is compiled is compiled again
each time, unoptimised: one to four minutes a mutant.
"""

import argparse
import ast
import math
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("terms", "engine", "methods")
TESTS = "energy order reaction statics contact bishop grasps jaws vibrations"
TESTS += " natural_shape explicit_methods external_damping recording following state"
SLOW = "not reference_is_converged"
LONGEST = 900  # [s] of the processor, whoever else uses it; a mutant that never ends is caught


def nodes(tree: ast.Module) -> Iterator[tuple[ast.AST, str]]:
    """What can be mutated, and how; indices and calls of `range` are left alone."""
    spared: set[ast.AST] = set()
    for node in ast.walk(tree):
        outside = [*getattr(node, "decorator_list", ())]
        if isinstance(node, ast.Subscript):
            outside.append(node.slice)
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "range":
            outside.append(node)
        elif isinstance(node, ast.Module):
            outside += [one for one in node.body if not isinstance(one, ast.FunctionDef)]
        spared.update(inner for one in outside for inner in ast.walk(one))
    for node in ast.walk(tree):
        if node in spared:
            continue
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            yield node, "sign flipped"
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield node, "sign flipped"
        elif isinstance(node, ast.Constant) and type(node.value) is float and node.value:
            yield node, "factor changed"
        elif isinstance(node, ast.AugAssign) or (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
        ):
            yield node, "left out"


def mutated(path: Path, number: int) -> tuple[str, str]:
    """The source with one place mutated, and what was done where."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    node, kind = list(nodes(tree))[number]
    assert isinstance(node, ast.expr | ast.stmt)
    what = f"{path.parent.name}/{path.name}:{node.lineno}: {kind}: {ast.unparse(node)[:60]}"
    if isinstance(node, ast.BinOp):
        node.op = ast.Sub() if isinstance(node.op, ast.Add) else ast.Add()
    elif isinstance(node, ast.UnaryOp):
        node.op = ast.UAdd()
    elif isinstance(node, ast.Constant):
        assert isinstance(node.value, float)
        node.value *= 1.5
    elif isinstance(node, ast.AugAssign):
        neutral = 0 if isinstance(node.op, ast.Add | ast.Sub | ast.BitOr) else 1
        node.value = ast.Constant(neutral)
    elif isinstance(node, ast.Expr):
        node.value = ast.Constant(None)
    return ast.unparse(ast.fix_missing_locations(tree)), what


def caught_by(copy: Path, name: str) -> str:
    """The first test that fails in the copy; those called like the file come first. Empty: none."""
    tests = sorted(copy.glob("test/engine/test_*.py"))
    tests += [copy / f"test/simulation/test_{one}.py" for one in TESTS.split()]
    tests.sort(key=lambda path: Path(name).stem not in path.stem)
    command = [sys.executable, "-m", "pytest", "-xq", "-p", "no:cacheprovider", "-k", SLOW]
    cache = copy / "machine_code"
    settings = {"NUMBA_OPT": "0", "DLO_SIM_CACHE": str(cache), "PYTHONPATH": str(copy)}
    try:
        done = subprocess.run(
            [*command, *map(str, tests)],
            cwd=copy,
            env=os.environ | settings,
            capture_output=True,
            text=True,
            preexec_fn=_limit,
        )
    finally:
        shutil.rmtree(cache, ignore_errors=True)
    if done.returncode == -signal.SIGXCPU:
        return "it does not end"
    lines = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return "" if done.returncode == 0 else (lines or [f"exit status {done.returncode}"])[0][:110]


def _limit() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST + 1))


def interval(caught: int, count: int) -> str:
    """A share with its 95 % interval (Wilson)."""
    share, z = caught / count, 1.96
    half = z * math.sqrt(share * (1.0 - share) / count + (z / count / 2) ** 2)
    low, high = ((share + z * z / count / 2 + s * half) / (1 + z * z / count) for s in (-1, 1))
    return f"caught {caught} of {count}, {share:.0%} ({low:.0%} to {high:.0%})"


def main() -> None:
    """Mutate, test, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    places = []
    for path in sorted(path for room in ROOMS for path in (ROOT / "dlo_sim" / room).glob("*.py")):
        found = list(nodes(ast.parse(path.read_text(encoding="utf-8"))))
        places += [(path.relative_to(ROOT), number) for number in range(len(found))]
    chosen = random.Random(given.seed).sample(places, given.count)
    print(f"{len(places)} places, {given.count} of them with seed {given.seed}", flush=True)
    survivors = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for part in ("dlo_sim", "test", "config"):
            shutil.copytree(ROOT / part, copy / part)
        for part in (".pytest.ini", "package.xml"):
            shutil.copy(ROOT / part, copy)
        assert not (red := caught_by(copy, "")), f"the tests fail without a mutation: {red}"
        for count, (name, number) in enumerate(chosen, 1):
            source, what = mutated(ROOT / name, number)
            (copy / name).write_text(source, encoding="utf-8")
            by = caught_by(copy, str(name))
            shutil.copy(ROOT / name, copy / name)
            survivors += [] if by else [what]
            score = interval(count - len(survivors), count)
            print(f"{what} -> {by or 'SURVIVED'}; {score}", flush=True)
    print("survivors:", *(survivors or ["none"]), sep="\n  ")


if __name__ == "__main__":
    main()
