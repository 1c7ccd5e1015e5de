"""A SIMD type for compiled code: eight numbers as one value, kept in a vector register.

A lane is one of eight neighbouring knot spans, so that a loop over the quadrature points of a span
serves eight spans at a time.

With NUMBA_DISABLE_JIT=1 the same names are numpy functions on arrays of shape (8,), so that a step
can be followed in a debugger.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from numba import config, types

LANES = 8

if config.DISABLE_JIT:

    class _Array(np.ndarray):
        """Lanes have value semantics: a += b makes a new value, as in compiled code."""

    for _name in ("add", "sub", "mul", "truediv"):
        setattr(_Array, f"__i{_name}__", getattr(np.ndarray, f"__{_name}__"))

    class _Vectors(np.ndarray):
        """Vectors along the last axis: a complete index gives a value of its own."""

        def __getitem__(self, index: Any) -> Any:
            found = super().__getitem__(index)
            whole = isinstance(found, np.ndarray) and found.shape == (LANES,)
            return found.copy().view(_Array) if whole else found

        def __setitem__(self, index: Any, value: Any) -> None:
            self.view(np.ndarray)[index] = value

    vector = types.Opaque("lanes")

    def as_vectors(array: Any) -> Any:
        """The array (..., LANES), whose entries have value semantics."""
        return array.view(_Vectors)

    def vector_of(numbers: Any) -> Any:
        """A vector of LANES numbers."""
        return np.array(numbers, dtype=float).view(_Array)

    def zero() -> Any:
        """Zero in all lanes."""
        return np.zeros(LANES).view(_Array)

    def sqrt(value: Any) -> Any:
        """Square root, lane by lane."""
        return np.sqrt(value)

    def fabs(value: Any) -> Any:
        """Absolute value, lane by lane."""
        return np.abs(value)

    def where(condition: Any, above: Any, other: Any) -> Any:
        """`above` on the lanes where the condition is above 0, else `other`."""
        return np.where(condition > 0.0, above, other).view(_Array)

    def any_above(value: Any) -> bool:
        """Whether any lane is above 0."""
        return bool((value > 0.0).any())

    def bits_above(value: Any) -> int:
        """A bit for every lane, 1 where it is above 0."""
        return sum(1 << k for k in range(LANES) if value[k] > 0.0)

    def lane_sum(value: Any) -> Any:
        """Sum over the lanes, pairwise."""
        halves = value.reshape(4, 2).sum(axis=1).reshape(2, 2).sum(axis=1)
        return halves[0] + halves[1]

    def lane(value: Any, k: int) -> Any:
        """Lane k."""
        return value[k]

else:
    from llvmlite import ir
    from numba.core.typing.templates import AbstractTemplate, infer_global, signature
    from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

    VECTOR = ir.VectorType(ir.DoubleType(), LANES)
    _INDEX = ir.IntType(32)

    class _Lanes(types.Type):
        def __init__(self) -> None:
            super().__init__(name="lanes")

    vector = _Lanes()

    @register_model(_Lanes)
    class _Model(models.PrimitiveModel):
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, VECTOR)

    def spread(context: Any, builder: Any, value: Any, kind: Any) -> Any:
        """A number in all lanes."""
        if kind is vector:
            return value
        number = context.cast(builder, value, kind, types.float64)
        start = ir.Constant(VECTOR, ir.Undefined)
        lane = builder.insert_element(start, number, ir.Constant(_INDEX, 0))
        everywhere = ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES)
        return builder.shuffle_vector(lane, start, everywhere)

    class _Binary(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            """Signature for two vectors, or a vector and a number."""
            known = all(kind is vector or isinstance(kind, types.Number) for kind in args)
            return signature(vector, *args) if known and vector in args else None

    def _define_binary(operations: tuple[Any, ...], instruction: str) -> None:
        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            both = [
                spread(context, builder, *pair) for pair in zip(values, signature.args, strict=True)
            ]
            return getattr(builder, instruction)(*both, flags=("contract",))

        for operation in operations:
            infer_global(operation)(_Binary)
            for a, b in ((vector, vector), (vector, types.Number), (types.Number, vector)):
                lower_builtin(operation, a, b)(code)

    _define_binary((operator.add, operator.iadd), "fadd")
    _define_binary((operator.sub, operator.isub), "fsub")
    _define_binary((operator.mul, operator.imul), "fmul")
    _define_binary((operator.truediv, operator.itruediv), "fdiv")

    @type_callable(operator.neg)
    def _typed_negative(context: Any) -> Any:
        return lambda value: vector if value is vector else None

    @lower_builtin(operator.neg, vector)
    def _negative(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.fsub(ir.Constant(VECTOR, [-0.0] * LANES), values[0])

    def as_vectors(array: Any) -> Any:
        """The array; its last axis are the lanes."""
        return array

    @intrinsic
    def zero(typing: Any) -> Any:
        """Zero in all lanes."""
        return vector(), lambda *_: ir.Constant(VECTOR, [0.0] * LANES)

    def _unary(name: str) -> Any:
        full = f"{name}.v{LANES}f64"

        def typed(typing: Any, value: Any) -> Any:
            def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
                known = builder.module.globals.get(full)
                kind = ir.FunctionType(VECTOR, [VECTOR])
                return builder.call(known or ir.Function(builder.module, kind, full), values)

            return (vector(vector), code) if value is vector else None

        return intrinsic(typed)

    sqrt = _unary("llvm.sqrt")  # square root, lane by lane
    fabs = _unary("llvm.fabs")  # absolute value, lane by lane

    @intrinsic
    def where(typing: Any, condition: Any, above: Any, other: Any) -> Any:
        """`above` on the lanes where the condition is above 0, else `other`."""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            kinds, none = signature.args[1:], ir.Constant(VECTOR, [0.0] * LANES)
            pairs = zip(values[1:], kinds, strict=True)
            chosen = [spread(context, builder, *pair) for pair in pairs]
            return builder.select(builder.fcmp_ordered(">", values[0], none), *chosen)

        return vector(vector, above, other), code

    @intrinsic
    def bits_above(typing: Any, value: Any) -> Any:
        """A bit for every lane, 1 where it is above 0."""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            above = builder.fcmp_ordered(">", values[0], ir.Constant(VECTOR, [0.0] * LANES))
            return builder.zext(builder.bitcast(above, ir.IntType(LANES)), ir.IntType(64))

        return types.int64(value), code

    @intrinsic
    def any_above(typing: Any, value: Any) -> Any:
        """Whether any lane is above 0."""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            above = builder.fcmp_ordered(">", values[0], ir.Constant(VECTOR, [0.0] * LANES))
            mask = builder.bitcast(above, ir.IntType(LANES))
            return builder.icmp_unsigned("!=", mask, ir.Constant(mask.type, 0))

        return types.boolean(value), code

    @intrinsic
    def lane_sum(typing: Any, value: Any) -> Any:
        """Sum over the lanes, pairwise."""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            index = [ir.Constant(_INDEX, lane) for lane in range(LANES)]
            parts = [builder.extract_element(values[0], lane) for lane in index]
            while len(parts) > 1:
                parts = [builder.fadd(*pair) for pair in zip(parts[::2], parts[1::2], strict=True)]
            return parts[0]

        return types.float64(value), code

    @intrinsic
    def lane(typing: Any, value: Any, k: Any) -> Any:
        """Lane k."""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.extract_element(values[0], builder.trunc(values[1], _INDEX))

        return types.float64(value, types.int64), code
