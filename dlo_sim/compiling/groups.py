"""Named numpy arrays in compiled code: `cable.state.x[d, i]` means the same there as in Python.

A class derived from `Group` declares its arrays once, with their shapes:

    class Mesh(Group):
        xi = Lanes("blocks", "samples")  # local coordinates of the quadrature points

    class Cable(Group):
        mesh: Mesh

`Cable(sizes)` allocates them, and `Cable.kind` is their type in signatures of compiled functions. A
group is passed as one pointer, to a table of addresses and shapes; Python owns the arrays, so the
table must not outlive them. Unlike numba's arrays, which take seven words each and a reference
count, this costs a call nothing.

In compiled code `grid[i, j]` is a number, `grid[i]` of two dimensions a row, `len` and `shape` are
numpy's. The entries of `Lanes` are vectors of LANES numbers (`compiling.lanes`); `load(grid, d, i)`
and `store(grid, d, i, vector)` access LANES successive entries of ordinary numbers.

With DLO_SIM_CHECK=1 every index is checked, and an IndexError names the dimension. (A kernel that
was called by another one cannot raise it: there Python writes it to stderr as unraisable, and the
run goes on with a result that means nothing.) With NUMBA_DISABLE_JIT=1 compiled functions are
Python, and grids the arrays themselves.

Typing and lowering of attributes follow numba's guide to extensions ("interval" example).
"""

from __future__ import annotations

import math
import operator
import os
import zlib
from collections.abc import Mapping
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, cast, get_type_hints, overload
from weakref import WeakValueDictionary

import numpy as np
from numba import config, from_dtype, types
from numpy.typing import NDArray

from dlo_sim.compiling import lanes
from dlo_sim.compiling.lanes import LANES

Array = NDArray[np.float64]
CHECKED = os.environ.get("DLO_SIM_CHECK", "") not in ("", "0")


class Grid(types.Type):
    """Type of an array without ownership: an address and a shape.

    Attributes:
        dtype: float64, int64, or `lanes.vector`. ndim: number of dimensions; that of the lanes does
            not count.
    """

    def __init__(self, dtype: types.Type, ndim: int) -> None:
        self.dtype, self.ndim = dtype, ndim
        super().__init__(name=f"{str(dtype)[0]}{ndim}")  # short, as in `GroupKind`


class GroupKind(types.Type):
    """Type of a group: a pointer to the table of its fields.

    Its name is short, as it becomes a part of the names of all functions that get it: with the
    fields in it instead of their checksum, compiling takes twice as long.
    """

    def __init__(self, name: str, fields: Mapping[str, types.Type]) -> None:
        self.fields = dict(fields)
        inside = ", ".join(f"{field}: {kind}" for field, kind in fields.items())
        super().__init__(name=f"{name}{zlib.crc32(inside.encode()):08x}")


VECTOR = Grid(types.float64, 1)
MATRIX = Grid(types.float64, 2)


class Field:
    """A declared array of a group: the names or numbers of its dimensions."""

    dtype: ClassVar[Any] = np.float64
    entry: ClassVar[types.Type] = types.float64
    inner: ClassVar[tuple[int, ...]] = ()

    def __init__(self, *dimensions: str | int) -> None:
        self.dimensions = dimensions

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Field: ...
    @overload
    def __get__(self, instance: Group, owner: type) -> Any: ...
    def __get__(self, instance: Group | None, owner: type) -> Any:
        """The declaration; an instance has its array under the same name."""
        return self

    if TYPE_CHECKING:

        def __set__(self, instance: Group, value: Any) -> None: ...

    @property
    def kind(self) -> types.Type:
        """Its type in compiled code."""
        return Grid(self.entry, len(self.dimensions))

    def shape(self, sizes: Mapping[str, int]) -> tuple[int, ...]:
        """Its shape in numpy for these sizes of the named dimensions."""
        return (*(sizes[d] if isinstance(d, str) else d for d in self.dimensions), *self.inner)


class Reals(Field):
    """Real numbers."""


class Wholes(Field):
    """Whole numbers."""

    dtype: ClassVar[Any] = np.int64
    entry: ClassVar[types.Type] = types.int64


class Lanes(Field):
    """Vectors of LANES real numbers."""

    entry: ClassVar[types.Type] = lanes.vector
    inner: ClassVar[tuple[int, ...]] = (LANES,)


class Number(Field):
    """One real number, constant in compiled code."""

    @property
    def kind(self) -> types.Type:
        """Its type in compiled code."""
        return types.float64


class Whole(Field):
    """One whole number, constant in compiled code."""

    dtype: ClassVar[Any] = np.int64

    @property
    def kind(self) -> types.Type:
        """Its type in compiled code."""
        return types.int64


class Numbers(Field):
    """Named real numbers that compiled code may change: `group.balance.dissipated += loss`."""

    def __init__(self, *names: str) -> None:
        super().__init__(len(names))
        self.record = np.dtype([(name, np.float64) for name in names])

    @property
    def kind(self) -> types.Type:
        """Its type in compiled code."""
        return cast(types.Type, from_dtype(self.record))


def aligned_zeros(count: int) -> Array:
    """Zeros from a multiple of 64 bytes on."""
    room = np.zeros(count + LANES - 1)
    begin = -(room.ctypes.data // room.itemsize) % LANES
    return room[begin : begin + count]


def numbers_of(record: Any) -> Array:
    """All of a `Numbers`, a view in their order."""
    return np.asarray(record).reshape(1).view(np.float64)


def _whole_vectors(count: int) -> int:
    """A number of entries rounded up to whole vectors."""
    return -(-count // LANES) * LANES


class Group:
    """Arrays and numbers that are passed together; see the module's docstring.

    The arrays of real numbers lie one after the other in one memory, each from a multiple of 64
    bytes on, so that vectors straddle no cache lines.

    Args:
        sizes: of the named dimensions. memory: where the arrays of real numbers are to lie, as many
            numbers as `room` says; default: allocated. given: groups that are not to be made.
    """

    fields: ClassVar[dict[str, Field]] = {}
    groups: ClassVar[dict[str, type[Group]]] = {}
    kind: ClassVar[GroupKind]

    def __init_subclass__(cls) -> None:
        cls.fields = {k: v for k, v in vars(cls).items() if isinstance(v, Field)}
        own = get_type_hints(cls) if "__annotations__" in vars(cls) else {}
        cls.groups = {k: own[k] for k in vars(cls).get("__annotations__", ())}
        members = {k: v.kind for k, v in (cls.fields | cls.groups).items()}
        cls.kind = GroupKind(cls.__name__, members)

    def __init__(
        self,
        sizes: Mapping[str, int],
        memory: Array | None = None,
        **given: Group | None,
    ) -> None:
        self.sizes = dict(sizes)
        for name, group in self.groups.items():
            setattr(self, name, given[name] if name in given else group(sizes))
        memory = aligned_zeros(self.room(sizes)) if memory is None else memory
        places, _ = self._layout(tuple(sizes.items()))
        for name, field in self.fields.items():
            if isinstance(field, (Number, Whole)):
                setattr(self, name, sizes.get(name, 0))
                continue
            shape = field.shape(sizes)
            if field.dtype is not np.float64:
                setattr(self, name, np.zeros(shape, field.dtype))
                continue
            at, count = places[name], math.prod(shape)
            setattr(self, name, self._array(field, memory[at : at + count].reshape(shape)))

    @staticmethod
    def _array(field: Field, array: Any) -> Any:
        if isinstance(field, Numbers):
            return array.view(field.record).view(np.recarray)[0]
        return lanes.as_vectors(array) if isinstance(field, Lanes) else array

    @classmethod
    def room(cls, sizes: Mapping[str, int]) -> int:
        """Real numbers in all arrays of the group itself, with what aligns them."""
        return cls._layout(tuple(sizes.items()))[1]

    @classmethod
    @lru_cache(maxsize=64)
    def _layout(cls, sizes: tuple[tuple[str, int], ...]) -> tuple[dict[str, int], int]:
        """Where the arrays of real numbers begin, and how many numbers they have; kept, as a cable
        has hundreds of arrays.
        """
        places, at, named = {}, 0, dict(sizes)
        for name, field in cls.fields.items():
            if field.dtype is np.float64 and not isinstance(field, Number):
                places[name] = at
                at += _whole_vectors(math.prod(field.shape(named)))
        return places, at

    def table(self) -> list[int]:
        """Addresses, shapes and numbers of all fields, in the order of `kind`."""
        out: list[int] = []
        for name in self.kind.fields:
            value, field = getattr(self, name), self.fields.get(name)
            if isinstance(value, Group):
                out += value.table()
            elif isinstance(field, Number):
                out.append(int(np.float64(value).view(np.int64)))
            elif isinstance(field, Whole):
                out.append(int(value))
            elif isinstance(field, Numbers):
                out.append(int(np.asarray(value).ctypes.data))
            else:
                dims = value.ndim - len(cast(Field, field).inner)
                # numpy's `ctypes.data` takes twice as long.
                out += [value.__array_interface__["data"][0], *value.shape[:dims]]
        return out

    def pack(self) -> NDArray[np.int64]:
        """The table that compiled code reads; `address_of` is what is passed to it."""
        return np.array(self.table(), dtype=np.int64)

    @cached_property
    def address(self) -> int:
        """The packed group for compiled functions; `pack_anew` after an array or a constant number
        was replaced.
        """
        self._packed = self.pack()  # lives as long as the group
        return address_of(self._packed, self)

    def pack_anew(self) -> None:
        """Let `address` be that of a new table."""
        vars(self).pop("address", None)

    def __getstate__(self) -> dict[str, Any]:
        """A copy packs its own arrays."""
        return {k: v for k, v in vars(self).items() if k not in ("address", "_packed")}


def address_of(table: NDArray[np.int64], group: Group) -> int:
    """The argument by which compiled functions get a packed group."""
    address = table.ctypes.data
    if config.DISABLE_JIT:
        _GROUPS[address] = group
    return address


_GROUPS: WeakValueDictionary[int, Group] = WeakValueDictionary()

if config.DISABLE_JIT:

    def group_at(kind: type[Group]) -> Any:
        """Function that finds the group that was packed at an address."""
        return _GROUPS.__getitem__

    def grid(array: Any) -> Any:
        """The array."""
        return array

    def load(numbers: Any, *index: int) -> Any:
        """LANES successive numbers."""
        *rows, at = index
        return lanes.vector_of(numbers[tuple(rows)][at : at + LANES])

    def store(numbers: Any, *arguments: Any) -> None:
        """Set LANES successive numbers: `store(grid, d, i, vector)`."""
        *rows, at, value = arguments
        numbers[tuple(rows)][at : at + LANES] = value

else:
    from llvmlite import ir
    from numba.core import cgutils
    from numba.core.typing.templates import AttributeTemplate, infer_getattr
    from numba.extending import (
        intrinsic,
        lower_builtin,
        lower_getattr,
        lower_getattr_generic,
        models,
        register_model,
        type_callable,
    )

    _WORD = ir.IntType(64)

    @register_model(Grid)
    class _GridModel(models.StructModel):
        def __init__(self, manager: Any, kind: Grid) -> None:
            entry = types.float64 if kind.dtype is lanes.vector else kind.dtype
            shape = types.UniTuple(types.intp, kind.ndim)
            super().__init__(manager, kind, [("data", types.CPointer(entry)), ("shape", shape)])

    @register_model(GroupKind)
    class _GroupModel(models.PrimitiveModel):
        def __init__(self, manager: Any, kind: GroupKind) -> None:
            super().__init__(manager, kind, _WORD.as_pointer())

    def _words(kind: types.Type) -> int:
        """Entries of a field in the table."""
        if isinstance(kind, GroupKind):
            return sum(map(_words, kind.fields.values()))
        return 1 + kind.ndim if isinstance(kind, Grid) else 1

    @infer_getattr
    class _Fields(AttributeTemplate):
        key = GroupKind

        def generic_resolve(self, group: GroupKind, name: str) -> types.Type | None:
            """Type of a field."""
            return group.fields.get(name)

    def _entry(builder: Any, table: Any, at: int) -> Any:
        word = builder.load(builder.gep(table, [ir.Constant(_WORD, at)]))
        word.set_metadata("invariant.load", builder.module.add_metadata([]))
        return word

    @lower_getattr_generic(GroupKind)
    def read_field(context: Any, builder: Any, group: GroupKind, table: Any, name: str) -> Any:
        """Lower `group.name`."""
        at = 0
        for field, kind in group.fields.items():
            if field == name:
                break
            at += _words(kind)
        kind = group.fields[name]
        if isinstance(kind, GroupKind):
            return builder.gep(table, [ir.Constant(_WORD, at)])
        word = _entry(builder, table, at)
        if kind == types.int64:
            return word
        if kind == types.float64:
            return builder.bitcast(word, ir.DoubleType())
        if not isinstance(kind, Grid):
            return builder.inttoptr(word, context.get_value_type(kind))
        made = cgutils.create_struct_proxy(kind)(context, builder)
        made.data = builder.inttoptr(word, made.data.type)
        sizes = [_entry(builder, table, at + 1 + d) for d in range(kind.ndim)]
        made.shape = context.make_tuple(builder, types.UniTuple(types.intp, kind.ndim), sizes)
        return made._getvalue()

    def group_at(kind: type[Group]) -> Any:
        """Compiled function that makes a group of its address."""

        @intrinsic
        def found(typing: Any, address: Any) -> Any:
            def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
                return builder.inttoptr(values[0], _WORD.as_pointer())

            return kind.kind(types.int64), code

        return found

    @intrinsic
    def grid(typing: Any, array: Any) -> Any:
        """The grid of an array that was passed from Python; in C order."""
        kind = Grid(array.dtype, array.ndim)

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            whole = context.make_array(signature.args[0])(context, builder, values[0])
            made = cgutils.create_struct_proxy(kind)(context, builder)
            made.data, made.shape = whole.data, whole.shape
            return made._getvalue()

        return kind(array), code

    def _address(
        context: Any, builder: Any, kind: Grid, value: Any, index: list[Any], wide: int = 1
    ) -> Any:
        """Address of the entry at an index, of which `wide` are read or written."""
        whole = cgutils.create_struct_proxy(kind)(context, builder, value)
        sizes = cgutils.unpack_tuple(builder, whole.shape)
        if CHECKED:
            for axis, (size, i) in enumerate(zip(sizes, index, strict=True)):
                last = builder.add(i, _WORD(wide - 1)) if axis == kind.ndim - 1 else i
                below = builder.icmp_signed("<", i, _WORD(0))
                beyond = builder.icmp_signed(">=", last, size)
                with builder.if_then(builder.or_(below, beyond), likely=False):
                    message = (f"index outside of dimension {axis} of a {kind}",)
                    context.call_conv.return_user_exc(builder, IndexError, message)
        at = index[0]
        for size, i in zip(sizes[1:], index[1:], strict=True):
            at = builder.add(builder.mul(at, size), i)
        if kind.dtype is lanes.vector:
            at = builder.mul(at, _WORD(LANES))
        return builder.gep(whole.data, [at])

    def _as_vector(builder: Any, address: Any) -> Any:
        return builder.bitcast(address, lanes.VECTOR.as_pointer())

    def _indices(context: Any, builder: Any, kind: Any, value: Any) -> list[Any]:
        if isinstance(kind, types.BaseTuple):
            parts = list(zip(cgutils.unpack_tuple(builder, value), kind.types, strict=True))
        else:
            parts = [(value, kind)]
        return [context.cast(builder, part, one, types.intp) for part, one in parts]

    def _count(index: types.Type) -> int:
        """Number of whole numbers in an index; 0 if it is none."""
        if isinstance(index, types.BaseTuple):
            return len(index) if all(isinstance(one, types.Integer) for one in index) else 0
        return 1 if isinstance(index, types.Integer) else 0

    @type_callable(operator.getitem)
    def _typed_get(context: Any) -> Any:
        def resolve(whole: Any, index: Any) -> Any:
            if not isinstance(whole, Grid) or not 0 < _count(index) <= whole.ndim:
                return None
            missing = whole.ndim - _count(index)
            return Grid(whole.dtype, missing) if missing else whole.dtype

        return resolve

    def _get(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind, result = signature.args[0], signature.return_type
        index = _indices(context, builder, signature.args[1], values[1])
        if not isinstance(result, Grid):
            address = _address(context, builder, kind, values[0], index)
            if result is lanes.vector:
                return builder.load(_as_vector(builder, address), align=8)
            return builder.load(address)
        first = [*index, *[_WORD(0)] * result.ndim]
        row = cgutils.create_struct_proxy(result)(context, builder)
        row.data = _address(context, builder, kind, values[0], first)
        whole = cgutils.create_struct_proxy(kind)(context, builder, values[0])
        sizes = cgutils.unpack_tuple(builder, whole.shape)[-result.ndim :]
        row.shape = context.make_tuple(builder, types.UniTuple(types.intp, result.ndim), sizes)
        return row._getvalue()

    @type_callable(operator.setitem)
    def _typed_set(context: Any) -> Any:
        def resolve(whole: Any, index: Any, value: Any) -> Any:
            return types.void if isinstance(whole, Grid) and _count(index) == whole.ndim else None

        return resolve

    def _set(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind, _, given = signature.args
        index = _indices(context, builder, signature.args[1], values[1])
        address = _address(context, builder, kind, values[0], index)
        if kind.dtype is lanes.vector:
            value = lanes.spread(context, builder, values[2], given)
            builder.store(value, _as_vector(builder, address), align=8)
        else:
            builder.store(context.cast(builder, values[2], given, kind.dtype), address)
        return context.get_dummy_value()

    for _index in (types.Integer, types.BaseTuple):
        lower_builtin(operator.getitem, Grid, _index)(_get)
        lower_builtin(operator.setitem, Grid, _index, types.Any)(_set)

    def load(numbers: Any, *index: int) -> Any:
        """LANES successive numbers."""
        raise NotImplementedError("only in compiled code")

    def store(numbers: Any, *arguments: Any) -> None:
        """Set LANES successive numbers: `store(grid, d, i, vector)`."""
        raise NotImplementedError("only in compiled code")

    def _loaded(numbers: Any, *index: Any) -> Any:
        """Type of `load`, None where the arguments do not fit."""
        fits = isinstance(numbers, Grid) and numbers.ndim == len(index)
        return lanes.vector if fits and numbers.dtype == types.float64 else None

    def _stored(numbers: Any, *index: Any) -> Any:
        """Type of `store`."""
        return types.void if _loaded(numbers, *index) else None

    # One signature for each number of dimensions, since numba folds *arguments into a tuple.
    type_callable(load)(lambda context: lambda numbers, i: _loaded(numbers, i))
    type_callable(load)(lambda context: lambda numbers, i, j: _loaded(numbers, i, j))
    type_callable(load)(lambda context: lambda numbers, i, j, k: _loaded(numbers, i, j, k))
    type_callable(store)(lambda context: lambda numbers, i, v: _stored(numbers, i))
    type_callable(store)(lambda context: lambda numbers, i, j, v: _stored(numbers, i, j))
    type_callable(store)(lambda context: lambda numbers, i, j, k, v: _stored(numbers, i, j, k))

    def _load(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind, *kinds = signature.args
        pairs = zip(values[1:], kinds, strict=True)
        index = [context.cast(builder, *pair, types.intp) for pair in pairs]
        address = _address(context, builder, kind, values[0], index, LANES)
        return builder.load(_as_vector(builder, address), align=8)

    def _store(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind, *kinds, given = signature.args
        pairs = zip(values[1:-1], kinds, strict=True)
        index = [context.cast(builder, *pair, types.intp) for pair in pairs]
        address = _address(context, builder, kind, values[0], index, LANES)
        value = lanes.spread(context, builder, values[-1], given)
        builder.store(value, _as_vector(builder, address), align=8)
        return context.get_dummy_value()

    for _dimensions in (1, 2, 3):
        _kinds = (Grid, *(types.Integer,) * _dimensions)
        lower_builtin(load, *_kinds)(_load)
        lower_builtin(store, *_kinds, types.Any)(_store)

    @infer_getattr
    class _Shape(AttributeTemplate):
        key = Grid

        def resolve_shape(self, whole: Grid) -> types.Type:
            """Type of `grid.shape`."""
            return types.UniTuple(types.intp, whole.ndim)

    @lower_getattr(Grid, "shape")
    def _shape(context: Any, builder: Any, kind: Grid, whole: Any) -> Any:
        return cgutils.create_struct_proxy(kind)(context, builder, whole).shape

    @type_callable(len)
    def _typed_len(context: Any) -> Any:
        return lambda whole: types.intp if isinstance(whole, Grid) else None

    @lower_builtin(len, Grid)
    def _len(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        whole = cgutils.create_struct_proxy(signature.args[0])(context, builder, values[0])
        return cgutils.unpack_tuple(builder, whole.shape)[0]
