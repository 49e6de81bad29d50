"""Everything that is used of numba beyond its documented interface.

Works with numba 0.62 to 0.68; `test_numba_versions.py` tests both ends.
"""

import io
import pickle
from collections.abc import Iterable
from typing import Any

from numba import types
from numba.core import config
from numba.core.compiler import compile_result
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys
from numba.core.serialize import NumbaPickler

from cmpsp_ros.mpsp.jit.parts import Part, Sized, environments_in, is_constant


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
    """A compiled part as bytes; None when it holds addresses of this process."""
    library, description = result.library, result.fndesc
    module = library._get_module_for_linking()  # noqa: SLF001 (numba's own name)
    if result.lifted or not is_constant(module):
        return None
    # What the translation alone needs.
    description.typemap = description.calltypes = None
    kept = (
        library.name,
        description,
        result.environment,
        result.signature,
        environments_in(module),
        library.machine_code,
        b'' if isinstance(library, Sized) else module.as_bitcode(),
    )
    file = io.BytesIO()
    _Pickler(file, protocol=4).dump(kept)
    return file.getvalue()


def load(data: bytes, classes: Iterable[type], target_context: Any) -> Any:
    """The part in the bytes of `dump`; `classes` are the named tuples in its signature.

    Numba's own way of loading begins with `target_context.refresh()`, which takes a second, and
    parses bitcode that only a compilation needs, which takes twice as long as the rest.

    Raises:
        Exception: Of any kind: a class that cannot be imported, or another version's bytes.
    """
    rtsys.initialize(target_context)
    kept = _Unpickler(io.BytesIO(data), classes).load()
    name, description, environment, signature, environments, machine_code, bitcode = kept
    library = Part(target_context.codegen(), name, bitcode)
    library.machine_code, library.environments = machine_code, environments
    return compile_result(
        typing_context=target_context.typing_context,
        target_context=target_context,
        library=library,
        environment=environment,
        fndesc=description,
        signature=signature,
        objectmode=False,
        lifted=(),
    )


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
