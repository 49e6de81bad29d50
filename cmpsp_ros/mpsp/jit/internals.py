"""Everything that is used of numba beyond its documented interface.

Works with numba 0.62 to 0.68; `test_numba_versions.py` tests both ends.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Iterable
from functools import partial
from typing import Any

from llvmlite import binding
from numba import types
from numba.core import config
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys
from numba.core.serialize import NumbaPickler


def set_cache(dispatcher: Any, cache: object) -> None:
    """Have a dispatcher ask ``cache`` before it compiles; numba's own way knows no other cache."""
    dispatcher._cache = cache  # noqa: SLF001


def address(overload: Any) -> int:
    """Address of the machine code of one signature, as other machine code calls it."""
    library, name = overload.library, overload.fndesc.llvm_func_name
    return int(library.get_pointer_to_function(name))


def cache_of(dispatcher: Any) -> object:
    """The cache of a dispatcher."""
    return getattr(dispatcher, '_cache', None)


def has_failed(event: Any) -> bool:
    """True where a compilation raised an exception; numba's `is_failed` says the opposite."""
    return event._exc_details is not None  # noqa: SLF001


def target_description(target_context: Any) -> tuple[Any, ...]:
    """Processor, its features and the options of the optimiser."""
    options = config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE, config.BOUNDSCHECK
    return (*target_context.codegen().magic_tuple(), *options)


def this_target() -> tuple[Any, ...]:
    """`target_description` of this computer."""
    return target_description(cpu_target.target_context)


def dump(result: Any) -> bytes | None:
    """A compiled result as bytes; None when it holds addresses of this process."""
    if any(not each.can_cache for each in result.lifted) or result.library.has_dynamic_globals:
        return None
    file = io.BytesIO()
    _Pickler(file, protocol=4).dump(result._reduce())  # noqa: SLF001 (as numba's own cache does)
    return file.getvalue()


def load(data: bytes, classes: Iterable[type], target_context: Any) -> Any:
    """The compiled result in the bytes of `dump`; `classes` are the named tuples in its signature.

    Numba's own way of loading begins with `target_context.refresh()`, which takes a second, and
    parses bitcode that only a compilation needs, which takes twice as long as the rest.

    Raises:
        Exception: Of any kind: a class that cannot be imported, or another version's bytes.
    """
    rtsys.initialize(target_context)
    kept = _Unpickler(io.BytesIO(data), classes).load()
    codegen, (_, description, *_) = target_context.codegen(), kept
    codegen._engine._defined_symbols |= {  # noqa: SLF001 (numba finds them in the bitcode)
        description.llvm_func_name,
        description.llvm_cpython_wrapper_name,
    }
    codegen.unserialize_library = partial(_restore, codegen)
    try:
        return CompileResult._rebuild(target_context, *kept)  # noqa: SLF001
    finally:
        del codegen.unserialize_library


class _Library(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """Machine code with bitcode that is parsed when something else is linked to it."""

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
    """Load as `JITCodeLibrary._unserialize` does, without parsing the bitcode."""
    name, _, (machine_code, bitcode) = kept
    library = _Library(codegen, name)
    library.enable_object_caching()
    library._set_compiled_object(machine_code)  # noqa: SLF001
    library._finalize_final_module()  # noqa: SLF001
    library.bitcode = bitcode
    return library


class _Pickler(NumbaPickler):  # type: ignore[misc]  # numba has no types
    """Keeps the names of classes; numba keeps copies of those of `__main__` and of functions."""

    def persistent_id(self, found: object) -> tuple[str, str] | None:
        if isinstance(found, type) and issubclass(found, tuple) and hasattr(found, '_fields'):
            return found.__module__, found.__qualname__
        return None


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, classes: Iterable[type]) -> None:
        super().__init__(file)
        self._classes = {(each.__module__, each.__qualname__): each for each in classes}

    def persistent_load(self, name: tuple[str, str]) -> Any:
        return self._classes.get(name) or self.find_class(*name)


def named_tuples(signature: Iterable[Any]) -> list[type]:
    """The classes of named tuples in a signature, also within each other."""
    found: list[type] = []
    for each in signature:
        if isinstance(each, types.BaseNamedTuple):
            found.append(each.instance_class)
        if isinstance(each, types.BaseTuple):
            found += named_tuples(each.types)
    return found
