"""Machine code of kernels whose bitcode is looked at only where it is asked for.

Numba keeps both: the machine code to be run, and bitcode for whatever is compiled later and calls
it. Reading the bitcode takes as long as loading the machine code and more memory than that needs,
and a process that compiles nothing has no use for it.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult


def rebuild(target_context: Any, kept: tuple[Any, ...]) -> Any:
    """What numba makes of a kernel, from what it keeps of it.

    Args:
        target_context: Of numba, for this processor.
        kept: Of `CompileResult`.
    """
    codegen, (_, description, *_) = target_context.codegen(), kept
    # Numba's own way of loading reads the bitcode to know what there is.
    codegen._engine._defined_symbols |= {  # noqa: SLF001 (there is no other way to tell it)
        description.llvm_func_name,
        description.llvm_cpython_wrapper_name,
    }
    codegen.unserialize_library = partial(_restore, codegen)
    try:
        return CompileResult._rebuild(target_context, *kept)  # noqa: SLF001 (as its cache does)
    finally:
        # What others keep in numba's own cache is loaded as ever.
        del codegen.unserialize_library


class _Library(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """Machine code, with bitcode that is parsed when it is linked to something else."""

    bitcode: bytes | None = None

    @property
    def _shared_module(self) -> Any:
        if self.bitcode is not None:
            self._parsed, self.bitcode = binding.parse_bitcode(self.bitcode), None
        return self._parsed

    @_shared_module.setter
    def _shared_module(self, module: Any) -> None:
        self._parsed = module


def _restore(codegen: Any, kept: tuple[str, str, tuple[bytes, bytes]]) -> Any:
    """Do what numba's `JITCodeLibrary` does, without reading the bitcode."""
    name, _, (machine_code, bitcode) = kept
    library = _Library(codegen, name)
    library.enable_object_caching()
    library._set_compiled_object(machine_code)  # noqa: SLF001 (as numba's own class does)
    library._finalize_final_module()  # noqa: SLF001
    library.bitcode = bitcode
    return library
