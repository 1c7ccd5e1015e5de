"""How near a step comes to the arithmetic that the processor can do.

Operations are counted by running the kernels' own source on numbers that count: an addition,
multiplication, division or square root is one operation each. The bound is a plain loop of fused
multiply-adds, which count two, on the same core in the same run.
"""

from __future__ import annotations

import types
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dlo_sim.kernels.elastic import span_gradient
from dlo_sim.kernels.multiply_add import CHAIN, multiply_add
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.stopwatch import Cost, least, step_cost

ELEMENTS = 1024
PASSES = 250  # 2 ms


class Counting:
    """A number that counts the operations done with it."""

    operations = 0

    def __init__(self, value: float) -> None:
        self.value = value

    @classmethod
    def _done(cls, value: float) -> Counting:
        Counting.operations += 1
        return Counting(value)

    def __add__(self, other: object) -> Counting:
        return self._done(self.value + _value(other))

    def __sub__(self, other: object) -> Counting:
        return self._done(self.value - _value(other))

    def __rsub__(self, other: object) -> Counting:
        return self._done(_value(other) - self.value)

    def __mul__(self, other: object) -> Counting:
        return self._done(self.value * _value(other))

    def __truediv__(self, other: object) -> Counting:
        return self._done(self.value / _value(other))

    def __rtruediv__(self, other: object) -> Counting:
        return self._done(_value(other) / self.value)

    def __neg__(self) -> Counting:
        return Counting(-self.value)  # free: the sign goes into the next operation

    def sqrt(self) -> Counting:
        """numpy's square root of an object array calls this."""
        return self._done(float(np.sqrt(self.value)))

    __radd__, __rmul__ = __add__, __mul__

    # What a kernel asks of a pivot; no arithmetic.
    def __abs__(self) -> Counting:
        return Counting(abs(self.value))

    def __gt__(self, other: object) -> bool:
        return self.value > _value(other)

    def __eq__(self, other: object) -> bool:
        return self.value == _value(other)

    __hash__ = None  # type: ignore[assignment]


def _value(number: object) -> float:
    return number.value if isinstance(number, Counting) else float(number)  # type: ignore[arg-type]


def operations(kernel: Callable[..., object], *arguments: object) -> int:
    """Floating-point operations of one call of a kernel, as its source is written.

    The source is run on counting numbers, and so is that of every kernel it calls; an expression
    that is written twice counts twice, though the compiler may compute it once.
    """
    counting = [_counting(argument) for argument in arguments]
    source = _source(kernel, {})
    Counting.operations = 0
    source(*counting)
    return Counting.operations


def _source(kernel: Any, known: dict[Any, Callable[..., object]]) -> Callable[..., object]:
    """What was compiled to a kernel, with every kernel that it calls likewise."""
    if kernel not in known:
        source = kernel.py_func
        used = {name: source.__globals__.get(name) for name in source.__code__.co_names}
        plain = {
            name: _source(value, known) for name, value in used.items() if hasattr(value, "py_func")
        }
        known[kernel] = types.FunctionType(source.__code__, source.__globals__ | plain)
    return known[kernel]


def _counting(argument: Any) -> Any:
    """Arrays of counting numbers in the place of arrays, also inside named tuples."""
    if isinstance(argument, np.ndarray) and argument.dtype == float:
        return np.vectorize(Counting, otypes=[object])(argument)
    if isinstance(argument, tuple) and hasattr(argument, "_replace"):
        return type(argument)(*(_counting(value) for value in argument))
    return argument


def operations_per_sample(simulator: Simulator) -> int:
    """Floating-point operations of one sample of the elastic force of this scene."""
    terms = simulator.model.terms
    lattice, dim = terms.lattice, len(terms.axes)
    one = lattice._replace(xi=lattice.xi[:1, :1, :1], weights=lattice.weights[:1, :1, :1])
    coefficients = np.linspace(0.5, 1.0, 3 * dim).reshape(1, -1, 1)
    gradient = np.zeros((1, 3 * dim, 1))
    spans = terms.span_stretch
    if spans is not None:
        spans = spans._replace(linear=spans.linear[:1, :1])
    arguments = (coefficients, one, terms.stretch, spans, terms.bend, None, terms.axes, gradient)
    return operations(span_gradient, *arguments)


@dataclass(frozen=True)
class Arithmetic:
    """Arithmetic of one step against the bound.

    Attributes:
        samples, lanes: quadrature points, and with the padding of the vector lanes.
        per_sample: operations of one sample; evaluations: force evaluations per step.
        step: time of a step. bound: operations per second of the multiply-add loop.
    """

    samples: int
    lanes: int
    per_sample: int
    evaluations: int
    step: Cost
    bound: float

    @property
    def rate(self) -> float:
        """Operations per second [1/s] of the samples alone, everything else counted as zero."""
        return self.samples * self.per_sample * self.evaluations / self.step.best

    @property
    def share(self) -> float:
        """Of the bound [-]."""
        return self.rate / self.bound

    @property
    def least_step(self) -> float:
        """Time [s] that the samples of a step would take at the bound."""
        return self.samples * self.per_sample * self.evaluations / self.bound


def multiply_add_rate() -> float:
    """Operations per second of one core in a plain loop of fused multiply-adds."""
    x = np.ones(ELEMENTS)

    def work() -> None:
        multiply_add(x, 0.999, 0.001, PASSES)

    return 2.0 * CHAIN * PASSES * ELEMENTS / least(work, 60).best


def measure(simulator: Simulator) -> Arithmetic:
    """Step, samples and bound in the same run."""
    weights = simulator.model.terms.lattice.weights
    before = multiply_add_rate()
    step = step_cost(simulator)
    return Arithmetic(
        samples=int(np.count_nonzero(weights)),
        lanes=weights.size,
        per_sample=operations_per_sample(simulator),
        evaluations=simulator.choice.method.force_evaluations,
        step=step,
        bound=max(before, multiply_add_rate()),
    )
