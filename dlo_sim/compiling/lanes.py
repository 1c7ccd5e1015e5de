"""A SIMD type for compiled code: eight numbers as one value, kept in a vector register.

Arrays are passed between functions as the bare address of their numbers.

A lane is a knot span of one cable, or the same span of eight cables. Loops over the samples of a
cable are written once, in lanes, and serve both.

With NUMBA_DISABLE_JIT the same names are numpy functions on arrays of shape (8,), so that a step
can be followed in a debugger.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from numba import config

LANES = 8

if config.DISABLE_JIT:

    class _Array(np.ndarray):
        """Lanes have value semantics: a += b makes a new value, as in compiled code."""

    for _name in ("add", "sub", "mul", "truediv"):
        setattr(_Array, f"__i{_name}__", getattr(np.ndarray, f"__{_name}__"))

    def bare(array: Any) -> Any:
        """The array."""
        return array

    def shifted(array: Any, offset: int) -> Any:
        """array[offset:]"""
        return array[offset:]

    def load(array: Any, index: int) -> Any:
        """array[index : index + LANES]"""
        return array[index : index + LANES].copy().view(_Array)

    def store(array: Any, index: int, value: Any) -> None:
        """array[index : index + LANES] = value"""
        array[index : index + LANES] = value

    def zero() -> Any:
        """Zero in all lanes."""
        return np.zeros(LANES).view(_Array)

    def root(value: Any) -> Any:
        """Square root, lane by lane."""
        return np.sqrt(value)

    def size(value: Any) -> Any:
        """Absolute value, lane by lane."""
        return np.abs(value)

    def total(value: Any) -> Any:
        """Sum over the lanes, pairwise."""
        halves = value.reshape(4, 2).sum(axis=1).reshape(2, 2).sum(axis=1)
        return halves[0] + halves[1]

    def first(value: Any) -> Any:
        """Lane 0."""
        return value[0]

else:
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

    _VECTOR = ir.VectorType(ir.DoubleType(), LANES)
    _INDEX = ir.IntType(32)

    class _Lanes(types.Type):
        def __init__(self) -> None:
            super().__init__(name="lanes")

    _lanes = _Lanes()

    @register_model(_Lanes)
    class _Model(models.PrimitiveModel):
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, _VECTOR)

    def _spread(context: Any, builder: Any, value: Any, kind: Any) -> Any:
        """A number in all lanes."""
        if kind is _lanes:
            return value
        number = context.cast(builder, value, kind, types.float64)
        start = ir.Constant(_VECTOR, ir.Undefined)
        lane = builder.insert_element(start, number, ir.Constant(_INDEX, 0))
        everywhere = ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES)
        return builder.shuffle_vector(lane, start, everywhere)

    def _define_binary(operations: tuple[Any, ...], instruction: str) -> None:
        def typed(context: Any) -> Any:
            def resolve(a: Any, b: Any) -> Any:
                known = all(kind is _lanes or isinstance(kind, types.Number) for kind in (a, b))
                return _lanes if known and _lanes in (a, b) else None

            return resolve

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            both = [
                _spread(context, builder, *pair)
                for pair in zip(values, signature.args, strict=True)
            ]
            return getattr(builder, instruction)(*both, flags=("contract",))

        for operation in operations:
            type_callable(operation)(typed)
            for a, b in ((_lanes, _lanes), (_lanes, types.Number), (types.Number, _lanes)):
                lower_builtin(operation, a, b)(code)

    _define_binary((operator.add, operator.iadd), "fadd")
    _define_binary((operator.sub, operator.isub), "fsub")
    _define_binary((operator.mul, operator.imul), "fmul")
    _define_binary((operator.truediv, operator.itruediv), "fdiv")

    @type_callable(operator.neg)
    def _typed_negative(context: Any) -> Any:
        return lambda value: _lanes if value is _lanes else None

    @lower_builtin(operator.neg, _lanes)
    def _negative(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.fsub(ir.Constant(_VECTOR, [-0.0] * LANES), values[0])

    @intrinsic
    def bare(typing: Any, array: Any) -> Any:
        """Address of an array's numbers: one machine word instead of seven, no reference count."""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return context.make_array(signature.args[0])(context, builder, values[0]).data

        return types.CPointer(array.dtype)(array), code

    @intrinsic
    def shifted(typing: Any, numbers: Any, offset: Any) -> Any:
        """numbers[offset:]"""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.gep(values[0], [values[1]])

        return numbers(numbers, types.intp), code

    def _address(builder: Any, numbers: Any, index: Any) -> Any:
        return builder.bitcast(builder.gep(numbers, [index]), _VECTOR.as_pointer())

    @intrinsic
    def load(typing: Any, numbers: Any, index: Any) -> Any:
        """numbers[index : index + LANES]"""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.load(_address(builder, *values), align=8)

        return _lanes(numbers, types.intp), code

    @intrinsic
    def store(typing: Any, numbers: Any, index: Any, value: Any) -> Any:
        """numbers[index : index + LANES] = value"""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            at = _address(builder, *values[:2])
            builder.store(_spread(context, builder, values[2], signature.args[2]), at, align=8)
            return context.get_dummy_value()

        return types.void(numbers, types.intp, value), code

    @intrinsic
    def zero(typing: Any) -> Any:
        """Zero in all lanes."""
        return _lanes(), lambda *_: ir.Constant(_VECTOR, [0.0] * LANES)

    def _unary(name: str) -> Any:
        full = f"{name}.v{LANES}f64"

        def typed(typing: Any, value: Any) -> Any:
            def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
                known = builder.module.globals.get(full)
                kind = ir.FunctionType(_VECTOR, [_VECTOR])
                return builder.call(known or ir.Function(builder.module, kind, full), values)

            return (_lanes(_lanes), code) if value is _lanes else None

        return intrinsic(typed)

    root = _unary("llvm.sqrt")  # square root, lane by lane
    size = _unary("llvm.fabs")  # absolute value, lane by lane

    @intrinsic
    def total(typing: Any, value: Any) -> Any:
        """Sum over the lanes, pairwise."""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            index = [ir.Constant(_INDEX, lane) for lane in range(LANES)]
            parts = [builder.extract_element(values[0], lane) for lane in index]
            while len(parts) > 1:
                parts = [builder.fadd(*pair) for pair in zip(parts[::2], parts[1::2], strict=True)]
            return parts[0]

        return types.float64(value), code

    @intrinsic
    def first(typing: Any, value: Any) -> Any:
        """Lane 0."""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.extract_element(values[0], ir.Constant(_INDEX, 0))

        return types.float64(value), code
