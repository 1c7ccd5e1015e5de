"""How kernels are written down for LLVM: numba's own way, without the copies.

A kernel takes a scene's terms as tuples of some hundred arrays. numba keeps every variable in
memory, each of these tuples as a whole, and writes a whole array description down and reads it back
for every element that a kernel touches. LLVM removes all of that, but it was nine tenths of what
LLVM had to read, and most of the time that a scene took to compile.

`Lowering` therefore keeps variables that are assigned once as values (`_Lower`), takes parts of
tuples and arrays from what they were put together from (`_Builder`), and leaves out what nobody
uses then (`_prune`). The arithmetic that is left is numba's, in numba's order.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import Any

from llvmlite import ir
from llvmlite.ir.instructions import (
    AllocaInstr,
    CallInstr,
    CastInstr,
    ExtractValue,
    GEPInstr,
    InsertValue,
    LoadInstr,
    PhiInstr,
    StoreInstr,
)
from numba.core import ir as numba_ir
from numba.core.analysis import compute_cfg_from_blocks, compute_use_defs, must_use_alloca
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import BaseNativeLowering

_PURE = (AllocaInstr, CastInstr, ExtractValue, GEPInstr, InsertValue, LoadInstr)


class _Builder(ir.IRBuilder):
    """Builds instructions, except those whose result is already at hand.

    `_held` maps a local variable (an alloca) to the block and the value last stored there. It is
    only used within that block, and no more once the variable's address went anywhere but into a
    load or a store.
    """

    def __init__(self, block: Any) -> None:
        super().__init__(block)
        self._held: dict[Any, tuple[Any, Any]] = {}
        self._escaped: set[Any] = set()

    def _insert(self, instr: Any) -> None:
        super()._insert(instr)
        if isinstance(instr, (LoadInstr, GEPInstr)):
            return
        passed = instr.operands[:1] if isinstance(instr, StoreInstr) else instr.operands
        for operand in passed:
            variable, _ = _place(operand)
            if isinstance(variable, AllocaInstr):
                self._escaped.add(variable)
                self._held.pop(variable, None)

    def _value(self, variable: Any) -> Any:
        block, value = self._held.get(variable, (None, None))
        return value if block is self.block else None

    def store(self, value: Any, ptr: Any, align: Any = None) -> Any:
        stored = super().store(value, ptr, align)
        variable, path = _place(ptr)
        if isinstance(variable, PhiInstr):  # it may be any variable
            self._held.clear()
        if not isinstance(variable, AllocaInstr) or variable in self._escaped:
            return stored
        before = self._value(variable)
        self._held.pop(variable, None)
        if path == []:
            self._held[variable] = self.block, value
        elif path and before is not None:
            self._held[variable] = self.block, self.insert_value(before, value, path)
        return stored

    def load(self, ptr: Any, name: str = "", align: Any = None, typ: Any = None) -> Any:
        variable, path = _place(ptr)
        value = self._value(variable) if typ is None and path is not None else None
        if value is None:
            return super().load(ptr, name, align, typ)
        return self.extract_value(value, path) if path else value

    def extract_value(self, agg: Any, idx: Any, name: str = "") -> Any:
        path = list(idx) if isinstance(idx, (tuple, list)) else [idx]
        while True:
            if isinstance(agg, InsertValue):
                there = list(agg.indices)
                if path[: len(there)] == there:
                    agg, path = agg.operands[1], path[len(there) :]
                    if not path:
                        return agg
                elif there[: len(path)] == path:
                    break  # only a part of what is asked for was put in there
                else:
                    agg = agg.operands[0]
            elif isinstance(agg, ExtractValue):
                agg, path = agg.operands[0], list(agg.indices) + path
            else:
                break
        if isinstance(agg, ir.Constant) and agg.constant in (None, ir.Undefined):
            part = agg.type
            for i in path:
                part = part.elements[i] if hasattr(part, "elements") else part.element
            return ir.Constant(part, agg.constant)
        return super().extract_value(agg, path, name)


def _place(pointer: Any) -> tuple[Any, list[int] | None]:
    """What a pointer points into, and the indices of the member; None if they are not constant."""
    path: list[int] | None = []
    while isinstance(pointer, GEPInstr):
        pointer, indices = pointer.pointer, pointer.indices
        constant = all(isinstance(i, ir.Constant) for i in indices)
        if path is None or not constant or indices[0].constant != 0:
            path = None
        else:
            path = [i.constant for i in indices[1:]] + path
    return pointer, path


def _prune(function: Any) -> None:
    """Remove instructions whose results nobody uses, and variables that nobody reads."""
    _remove_unused(function)
    read: set[Any] = set()
    for block in function.blocks:
        for instruction in block.instructions:
            if not isinstance(instruction, (LoadInstr, CallInstr)):
                instruction.metadata.pop("range", None)
            if isinstance(instruction, GEPInstr):
                continue
            addresses = _operands(instruction)
            if isinstance(instruction, StoreInstr):
                addresses = addresses[:1]
            read.update(_place(operand)[0] for operand in addresses)
    for block in function.blocks:
        block.instructions[:] = [
            instruction
            for instruction in block.instructions
            if not isinstance(instruction, StoreInstr)
            or not isinstance(variable := _place(instruction.operands[1])[0], AllocaInstr)
            or variable in read
        ]
    _remove_unused(function)


def _remove_unused(function: Any) -> None:
    uses: Counter[int] = Counter()
    for block in function.blocks:
        for instruction in block.instructions:
            uses.update(map(id, _operands(instruction)))
    for block in reversed(function.blocks):
        kept = []
        for instruction in reversed(block.instructions):
            if isinstance(instruction, _PURE):
                if not uses[id(instruction)]:
                    uses.subtract(map(id, _operands(instruction)))
                    continue
            kept.append(instruction)
        block.instructions[:] = kept[::-1]


def _ignore(*_: object) -> None:
    pass


def _operands(instruction: Any) -> list[Any]:
    operands = list(instruction.operands)
    if isinstance(instruction, PhiInstr):
        operands += [value for value, _ in instruction.incomings]
    elif hasattr(instruction, "callee"):
        operands.append(instruction.callee)
    return operands


class _Lower(Lower):
    """numba's lowering of code without reference counts."""

    def setup_function(self, fndesc: Any) -> None:
        super().setup_function(fndesc)
        self.builder = _Builder(self.entry_block)
        self.call_helper = self.call_conv.init_call_helper(self.builder)

        for argument in self.function.args:
            argument.set_metadata = _ignore  # numba would mark the lengths it loads

    def lower_normal_function(self, fndesc: Any) -> None:
        super().lower_normal_function(fndesc)
        _prune(self.function)

    def _find_singly_assigned_variable(self) -> None:
        """numba keeps a variable as a value if only one block knows it. The same holds for every
        variable that is assigned once, before (in all paths) it is used."""
        super()._find_singly_assigned_variable()
        blocks = self.func_ir.blocks
        assigned: Counter[str] = Counter()
        for block in blocks.values():
            assigned.update(a.target.name for a in block.find_insts(numba_ir.Assign))
        use_defs = compute_use_defs(blocks)
        where: dict[str, int] = {}
        for label, names in use_defs.defmap.items():
            where.update((name, label) for name in names if assigned[name] == 1)
        users: dict[str, set[int]] = defaultdict(set)
        for label, names in use_defs.usemap.items():
            for name in names:
                users[name].add(label)
        dominators = compute_cfg_from_blocks(blocks).dominators()
        in_memory = must_use_alloca(blocks)
        for name, label in where.items():
            if name not in in_memory and all(
                label < user and label in dominators[user] for user in users[name]
            ):
                self._singly_assigned_vars.add(name)

    def storevar(self, value: Any, name: str, argidx: int | None = None) -> None:
        if name in self._singly_assigned_vars:
            self._blk_local_varmap[name] = value
        else:
            self._alloca_var(name, self.typeof(name))
            self.builder.store(value, self.getvar(name))

    def delvar(self, name: str) -> None:
        """Nothing to do: no references are counted."""


@register_pass(mutates_CFG=True, analysis_only=False)
class Lowering(BaseNativeLowering):
    """The compiler pass in the place of numba's `NativeLowering`."""

    _name = "kernel_lowering"

    @property
    def lowering_class(self) -> type:
        """Writes down one kernel."""
        return _Lower
