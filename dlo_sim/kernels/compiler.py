"""numba's compiler for kernels: whole programs, and nothing that only other programs need.

A scene's entries call some 120 kernels, all of them copied into the entry. Compared with numba's
compiler for separate functions, this one
- optimises an entry as a whole, once (`_Part`, `_Whole`);
- skips the stages that kernels have no use for (`_UNUSED_STAGES`);
- writes them down without copies (`lowering`) and looks up operators once (`resolution`).
What others compile in the same process is not affected.
"""

from __future__ import annotations

from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.typed_passes import NativeLowering

from dlo_sim.kernels.lowering import Lowering
from dlo_sim.kernels.resolution import remembering

_UNUSED_STAGES = {  # for closures, with blocks, raised exceptions, array expressions and the like
    "WithLifting",
    "InlineClosureLikes",
    "RewriteDynamicRaises",
    "MakeFunctionToJitFunction",
    "InlineInlinables",
    "FindLiterallyCalls",
    "LiteralUnroll",
    "LiteralPropagationSubPipelinePass",
    "InlineOverloads",
    "NopythonRewrites",
    "DumpParforDiagnostics",
}


class _Whole(JITCodeLibrary):
    """The code of an entry with all the kernels below it."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """As numba does, except for functions that are only declared here."""
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration:
                passes, builder = self._codegen._function_pass_manager()
                passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        """LLVM's second level, without several loop passes at a time.

        numba's third level and its preparations (for reference counts) made the code longer and
        took a quarter more time, but the code was not faster: the loops are short.
        """
        try:
            tuning = binding.create_pipeline_tuning_options(speed_level=2)
            tuning.loop_vectorization = True
            tuning.loop_interleaving = False
            builder = binding.create_pass_builder(self._codegen._tm, tuning)
        except AttributeError:
            super()._optimize_final_module()
        else:
            builder.getModulePassManager().run(self._final_module, builder)


class _Part(_Whole):
    """The code of one kernel, only ever linked into entries, which are optimised as a whole.

    numba would link every kernel with all that it calls and optimise that, level by level, and turn
    each into machine code that nobody runs: a fifth of the time that a scene takes to compile.
    """

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> _Part:
        return self

    def set_env(self, name: str, environment: object) -> None:
        """Nothing to set: kernels make no Python objects, and there is no machine code."""


class _Alone:
    """A part without what it calls, which an entry links once for all its parts."""

    def __init__(self, part: _Part) -> None:
        self._part = part
        self._reload_init = part._reload_init

    def _get_module_for_linking(self) -> Any:
        return self._part._final_module


class EntryCompiler(Compiler):
    """The compiler of an entry."""

    _library: type[_Whole] = _Whole

    def __init__(
        self, typing: Any, target: Any, library: Any, args: Any, result: Any, flags: Any, types: Any
    ) -> None:
        target.refresh()
        typing = remembering(typing)
        target = target.subtarget(typing_context=typing)
        target.load_additional_registries = _nothing  # just done; numba would a thousand times
        if library is None:
            library = self._library(target.codegen(), "kernel")
            library.enable_object_caching()
        super().__init__(typing, target, library, args, result, flags, types)

    def define_pipelines(self) -> list[Any]:
        """numba's stages, as they are done here."""
        pipelines: list[Any] = super().define_pipelines()
        for pipeline in pipelines:
            pipeline.passes = [
                (Lowering if stage is NativeLowering else stage, name)
                for stage, name in pipeline.passes
                if stage.__name__ not in _UNUSED_STAGES
            ]
        return pipelines


class PartCompiler(EntryCompiler):
    """The compiler of a kernel that only other kernels call."""

    _library = _Part


def _nothing() -> None:
    pass
