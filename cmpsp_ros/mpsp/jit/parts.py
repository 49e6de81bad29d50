"""Kernels in parts: a function is translated once, and optimised with all that it calls.

Numba optimises a function and makes machine code of it as soon as another one calls it, and does so
again, as a part of its caller, at each level of calls. Here a function that others call stays
bitcode. What Python calls, or asks the address of, is linked from such parts, optimised as a whole
and made machine code of, once.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import CodeType
from typing import Any

from llvmlite import binding
from numba import types
from numba.core import compiler
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import register_pass
from numba.core.dispatcher import OmittedArg
from numba.core.environment import lookup_environment
from numba.core.imputils import user_function
from numba.core.registry import CPUDispatcher
from numba.core.targetconfig import ConfigStack
from numba.core.typed_passes import InlineOverloads, NativeLowering, NopythonRewrites
from numba.core.untyped_passes import (
    FindLiterallyCalls,
    InlineClosureLikes,
    InlineInlinables,
    LiteralUnroll,
    MakeFunctionToJitFunction,
    WithLifting,
)

from cmpsp_ros.mpsp.jit.by_reference import ReferenceLower

_ENVIRONMENT = '_ZN08NumbaEnv'
_DYNAMIC = 'numba.dynamic.globals'
_UNNEEDED = frozenset({
    WithLifting, InlineClosureLikes, MakeFunctionToJitFunction, InlineInlinables,
    FindLiterallyCalls, LiteralUnroll, InlineOverloads, NopythonRewrites,
})  # fmt: skip
"""Passes for what a function without arrays and functions of its own cannot contain."""
_MANY = 'linkonce_odr'
"""Linkage of functions that are in several modules, and dropped where nothing calls them."""


class Part(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """Bitcode of a function; with that of all it calls if it comes from a file.

    Args:
        codegen: Numba's code generator.
        name: Name of the function.
        bitcode: Content of a file; it is parsed when something is linked with it.
    """

    bitcode: bytes | None = None
    """Content of a file that has not been parsed."""
    machine_code: bytes | None = None
    """Machine code of the function and all that it calls, until it is loaded."""
    environments: tuple[Any, ...] = ()
    """Numba's `Environment` of it and of all that it calls, where they come from a file."""

    def __init__(self, codegen: Any, name: str, bitcode: bytes | None = None) -> None:
        super().__init__(codegen, name)
        self.bitcode, self._shared_module = bitcode, None

    @property
    def _final_module(self) -> Any:
        if self.bitcode is not None:
            self._own, self.bitcode = binding.parse_bitcode(self.bitcode), None
        return self._own

    @_final_module.setter
    def _final_module(self, module: Any) -> None:
        self._own = module

    def add_ir_module(self, ir_module: Any) -> None:
        """Take a function as numba has translated it."""
        super().add_ir_module(ir_module)
        _relink(self._own, _MANY)

    def _optimize_functions(self, ll_module: Any) -> None:
        # Numba makes a pass manager for each function, also for those that are only declared.
        ll_module.data_layout = self._codegen._data_layout  # noqa: SLF001
        passes, builder = self._codegen._function_pass_manager()  # noqa: SLF001
        for each in ll_module.functions:
            if not each.is_declaration:
                passes.run(each, builder)

    def add_linking_library(self, library: Any) -> None:
        """Note the code of a function that is called; numba would make machine code of it."""
        self._linking_libraries.append(library)

    def _ensure_finalized(self) -> None:
        pass

    def _get_module_for_linking(self) -> Any:
        """All parts in one module, for functions that numba compiles in its own way."""
        if self._shared_module is None:
            names = [each.name for each in self._own_functions()]
            self._shared_module = self.linked(names)
            _relink(self._shared_module, _MANY)
        return self._shared_module

    def _own_functions(self) -> Iterator[Any]:
        return (each for each in self._final_module.functions if not each.is_declaration)

    def linked(self, names: Iterable[str]) -> Any:
        """Functions of this part with everything that they call, in one module."""
        module = self._final_module.clone()
        for name in names:
            module.get_function(name).linkage = 'external'
        for each in _callers_first(self)[1:]:
            if isinstance(each, Part) or not each._finalized:  # noqa: SLF001 (numba's attribute)
                module.link_in(each._final_module, preserve=True)  # noqa: SLF001
            else:
                module.link_in(each._get_module_for_linking(), preserve=True)  # noqa: SLF001
        return module


def _callers_first(part: Part) -> list[Any]:
    """A part and all that it needs, each after everything that needs it.

    The linker takes only functions that something calls that is there already.
    """
    found: dict[Any, None] = {}

    def visit(library: Any) -> None:
        if library not in found:
            if not library._finalized:  # noqa: SLF001 (numba's attribute)
                for each in library._linking_libraries:  # noqa: SLF001
                    visit(each)
            found[library] = None

    visit(part)
    return [*found][::-1]


def _relink(module: Any, linkage: str, but: Iterable[str] = ()) -> None:
    """Change the linkage of the functions in a module."""
    for each in module.functions:
        if not each.is_declaration and each.linkage.name != 'internal' and each.name not in but:
            each.linkage = linkage


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(NativeLowering):  # type: ignore[misc]  # numba has no types
    _name = 'lowering_by_reference'

    @property
    def lowering_class(self) -> Any:
        """Class that translates a function."""
        return ReferenceLower


class _Compiler(compiler.CompilerBase):  # type: ignore[misc]  # numba has no types
    """Translates a function to a `Part`."""

    def define_pipelines(self) -> list[Any]:
        state = self.state
        state.library = Part(state.targetctx.codegen(), state.func_id.func_qualname)
        flags = state.flags
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(state)
        passes.add_pass_after(_Lowering, NativeLowering)
        constants = state.func_id.code.co_consts
        is_plain = not flags.nrt and not any(isinstance(each, CodeType) for each in constants)
        left_out = {NativeLowering, *(_UNNEEDED if is_plain else ())}
        passes.passes = [each for each in passes.passes if each[0] not in left_out]
        passes.finalize()
        return [passes]


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Keep all objects while numba makes many that stay: to look through them takes a tenth."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class _Key:
    """By which numba finds the function that it calls for a signature."""


class Kernel(CPUDispatcher):  # type: ignore[misc]  # numba has no types
    """Numba's dispatcher of a function that is compiled in parts.

    Args:
        function: The function.
        options: Numba's options.
        cache: Called with the kernel, for the cache of its parts and machine code.
    """

    def __init__(
        self, function: Callable[..., Any], options: dict[str, Any], cache: Callable[[Kernel], Any]
    ) -> None:
        super().__init__(function, {}, {'nopython': True} | options, _Compiler)
        self._cache = cache(self)
        self._entries: dict[Any, Any] = {}

    def add_overload(self, result: Any) -> None:
        """Keep a part for callers; Python finds no function for its signature yet."""
        if result.entry_point is None:
            result = result._replace(entry_point=_Key())
            found = user_function(result.fndesc, [result.library])
            self.targetctx._defns[result.entry_point].append(found, result.signature.args)  # noqa: SLF001
        self.overloads[tuple(result.signature.args)] = result

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Numba's, for the same code whether a caller passes a constant or a variable."""
        named = {name: types.unliteral(each) for name, each in kws.items()}
        return super().get_call_template(tuple(map(types.unliteral, args)), named)

    def compile(self, sig: Any) -> Any:
        """Translate the function for a signature, unless that is done, or a file has it."""
        with _no_garbage_collection():
            return super().compile(sig)

    def entry(self, signature: tuple[Any, ...]) -> Any:
        """Python's function for a signature, compiled if need be."""
        if signature not in self._entries:
            with global_compiler_lock:
                self.compile(signature)
                part = self.overloads[signature]
                library = self._cache.finish(signature, part, self._make) or _loaded(part)
                found = self.targetctx.get_executable(library, part.fndesc, part.environment)
                self._entries[signature] = found, library
                if self._has_wrapper:
                    self._insert([each._code for each in signature], found, part.objectmode)  # noqa: SLF001
        return self._entries[signature][0]

    def address(self, signature: tuple[Any, ...]) -> int:
        """Address of the machine code for a signature, as other machine code calls it."""
        self.entry(signature)
        name = self.overloads[signature].fndesc.llvm_func_name
        return int(self._entries[signature][1].get_pointer_to_function(name))

    def _compile_for_args(self, *arguments: Any, **kwargs: Any) -> Any:
        super()._compile_for_args(*arguments, **kwargs)
        return self.entry(tuple(map(self._type_of, arguments)))

    def _type_of(self, value: Any) -> Any:
        omitted = isinstance(value, OmittedArg)
        return types.Omitted(value.value) if omitted else self.typeof_pyval(value)

    @property
    def _has_wrapper(self) -> bool:
        return not self.targetoptions.get('no_cpython_wrapper')

    def _make(self, part: Any) -> Any:
        """Make machine code of a part and all that it calls, with an entry for Python."""
        name = part.fndesc.llvm_func_name
        library = JITCodeLibrary(self.targetctx.codegen(), part.library.name)
        library.enable_object_caching()
        module = part.library.linked([name])
        _relink(module, 'internal', but=[name])
        library._final_module.link_in(module)  # noqa: SLF001 (numba's way optimises it before)
        if self._has_wrapper:
            self._add_wrapper(library, part)
        library.finalize()
        part.library.machine_code = library._get_compiled_object()  # noqa: SLF001
        _set_environments(library, environments_in(library._final_module))  # noqa: SLF001
        return library

    def _add_wrapper(self, library: Any, part: Any) -> None:
        flags = compiler.Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        self.targetctx.refresh()
        with ConfigStack().enter(flags):
            context = compiler._make_subtarget(self.targetctx, flags)  # noqa: SLF001
            context.create_cpython_wrapper(library, part.fndesc, part.environment, None)


def _loaded(part: Any) -> Any:
    """Machine code that is there, made ready to run."""
    library = JITCodeLibrary(part.library.codegen, part.library.name)
    library.enable_object_caching()
    library._set_compiled_object(part.library.machine_code)  # noqa: SLF001
    library._finalize_final_module()  # noqa: SLF001
    # Numba finds them in the bitcode.
    names = part.fndesc.llvm_func_name, part.fndesc.llvm_cpython_wrapper_name
    library.codegen._engine._defined_symbols.update(names)  # noqa: SLF001
    _set_environments(library, part.library.environments)
    return library


def _set_environments(library: Any, environments: Iterable[Any]) -> None:
    for each in environments:
        library.codegen.set_env(each.env_name, each)


def environments_in(module: Any) -> tuple[Any, ...]:
    """Numba's `Environment` of each function in a module."""
    names = [each.name for each in module.global_variables]
    found = [lookup_environment(each) for each in names if each.startswith(_ENVIRONMENT)]
    return tuple(each for each in found if each is not None and each.can_cache())


def is_constant(module: Any) -> bool:
    """True for a module without addresses of this process."""
    return not any(each.name.startswith(_DYNAMIC) for each in module.global_variables)
