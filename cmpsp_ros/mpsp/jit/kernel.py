"""Kernels: functions that are translated to parts, and made machine code of for Python's calls."""

from __future__ import annotations

import gc
import hashlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from types import CodeType
from typing import Any, Final

from numba import types
from numba.core import compiler, event
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager, _pass_registry, register_pass
from numba.core.dispatcher import OmittedArg
from numba.core.funcdesc import default_mangler
from numba.core.imputils import user_function
from numba.core.registry import CPUDispatcher
from numba.core.targetconfig import ConfigStack
from numba.core.typed_passes import (
    AnnotateTypes,
    InlineOverloads,
    IRLegalization,
    NativeLowering,
    NopythonRewrites,
)
from numba.core.untyped_passes import (
    FindLiterallyCalls,
    InlineClosureLikes,
    InlineInlinables,
    LiteralUnroll,
    MakeFunctionToJitFunction,
    WithLifting,
)

from cmpsp_ros.mpsp.jit.lowering import PartLower
from cmpsp_ros.mpsp.jit.parts import MachineCode, Part, Sized, environments_in, for_sizes, relink
from cmpsp_ros.mpsp.jit.sizes import NotGeneralError, generalised, is_general

# Passes for what a function without arrays and functions of its own cannot contain or need.
_UNNEEDED = frozenset({
    WithLifting, InlineClosureLikes, MakeFunctionToJitFunction, InlineInlinables,
    FindLiterallyCalls, LiteralUnroll, InlineOverloads, NopythonRewrites, IRLegalization,
    AnnotateTypes,
})  # fmt: skip


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(NativeLowering):  # type: ignore[misc]  # numba has no types
    _name = 'lowering_by_reference'

    @property
    def lowering_class(self) -> Any:
        """Class that translates a function."""
        return PartLower


class _Passes(PassManager):  # type: ignore[misc]  # numba has no types
    """Passes without the analysis of lifetimes after each, which none here needs."""

    def run(self, state: Any) -> None:
        """Run them in order."""
        for kind, _ in self.passes:
            each = _pass_registry.get(kind).pass_inst
            each.analysis = self._analysis
            each.run_initialization(state)
            each.run_pass(state)
            each.run_finalizer(state)


def _short_name(name: str, kinds: Iterable[Any], **more: Any) -> str:
    """Name of a function in bitcode, with a digest of the types of its arguments."""
    digest = hashlib.sha256(' '.join(map(str, kinds)).encode()).hexdigest()
    return str(default_mangler(f'{name}.{digest[:16]}', (), **more))


class _Compiler(compiler.CompilerBase):  # type: ignore[misc]  # numba has no types
    """Translates a function to a `Part`."""

    def define_pipelines(self) -> list[Any]:
        state = self.state
        codegen, name = state.targetctx.codegen(), state.func_id.func_qualname
        state.library = Part(codegen, name, is_general=is_general(state.args))
        # The names of types, which are all fields of all records, would be most of the bitcode.
        state.targetctx.mangler = _short_name
        flags = state.flags
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(state)
        passes.add_pass_after(_Lowering, NativeLowering)
        constants = state.func_id.code.co_consts
        is_plain = not flags.nrt and not any(isinstance(each, CodeType) for each in constants)
        left_out = {NativeLowering, *(_UNNEEDED if is_plain else ())}
        passes.passes = [each for each in passes.passes if each[0] not in left_out]
        if is_plain:
            passes.__class__ = _Passes
        passes.finalize()
        return [passes]


_types_found: Final[dict[Any, Any]] = {}


class _Outermost:
    """Changes to numba and Python while a function is translated, with all that it calls.

    Objects stay, since numba makes many and to look through them takes a tenth. Types of calls
    are found once: numba tries dozens of candidates at each ``+``.
    """

    depth = 0

    @classmethod
    @contextmanager
    def entered(cls, context: Any) -> Iterator[None]:
        """Enter for numba's typing context, unless that is done."""
        was_enabled = gc.isenabled()
        cls.depth += 1
        if cls.depth == 1:
            gc.disable()
            context.resolve_function_type = partial(_function_type, context)
        try:
            yield
        finally:
            cls.depth -= 1
            if cls.depth == 0:
                del context.resolve_function_type
                if was_enabled:
                    gc.enable()


def _function_type(context: Any, function: Any, kinds: tuple[Any, ...], named: Any) -> Any:
    """Numba's `resolve_function_type`, remembered for all but kernels and constant indices."""
    key = function, kinds
    if named or isinstance(function, (str, types.Dispatcher)):
        return type(context).resolve_function_type(context, function, kinds, named)
    if _types_found.get(key) is None:
        _types_found[key] = type(context).resolve_function_type(context, function, kinds, named)
    return _types_found[key]


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
        with global_compiler_lock, _Outermost.entered(self.typingctx):
            return super().compile(sig)

    def entry(self, signature: tuple[Any, ...]) -> Any:
        """Python's function for a signature, compiled if need be."""
        if signature not in self._entries:
            with global_compiler_lock:
                part, made = self._finished(signature)
                library = made or _loaded(part)
                found = self.targetctx.get_executable(library, part.fndesc, part.environment)
                self._entries[signature] = found, library, part
                if self._has_wrapper:
                    self._insert([each._code for each in signature], found, part.objectmode)  # noqa: SLF001
        return self._entries[signature][0]

    def _finished(self, signature: tuple[Any, ...]) -> tuple[Any, Any]:
        """Part with machine code for a signature, and the library where it had to be made."""
        general, sizes = generalised(signature)
        if sizes is not None:
            # Before its general part, which no file has for a kernel without an entry for Python.
            known = self._cache.load_machine_code(signature, Sized)
            if known is not None:
                return known, None
        part = self._part_for(signature, general, sizes)
        make = self._make_sized if isinstance(part.library, Sized) else self._make
        found: tuple[Any, Any] = self._cache.finish(signature, part, make)
        return found

    def _part_for(self, signature: tuple[Any, ...], general: tuple[Any, ...], sizes: Any) -> Any:
        try:
            self.compile(general)
        except NotGeneralError:
            general, sizes = signature, None
            self.compile(general)
        part = self.overloads[general]
        return part if sizes is None else for_sizes(part, signature, sizes)

    def address(self, signature: tuple[Any, ...]) -> tuple[int, Any]:
        """Address of the machine code for a signature, for other machine code; type returned."""
        self.entry(signature)
        _, library, part = self._entries[signature]
        address = library.get_pointer_to_function(part.fndesc.llvm_func_name)
        return int(address), part.signature.return_type

    def _compile_for_args(self, *arguments: Any, **kwargs: Any) -> Any:
        signature = tuple(map(self._type_of, arguments))
        if generalised(signature).sizes is None:
            super()._compile_for_args(*arguments, **kwargs)
        return self.entry(signature)

    def _type_of(self, value: Any) -> Any:
        omitted = isinstance(value, OmittedArg)
        return types.Omitted(value.value) if omitted else self.typeof_pyval(value)

    @property
    def _has_wrapper(self) -> bool:
        return not self.targetoptions.get('no_cpython_wrapper')

    def _make_sized(self, part: Any) -> Any:
        """The same for one size, which counts as a compilation of its own."""
        about = {'dispatcher': self, 'args': part.signature.args, 'return_type': None}
        with event.trigger_event('numba:compile', about):
            return self._make(part)

    def _make(self, part: Any) -> Any:
        """Make machine code of a part and all that it calls, with an entry for Python."""
        name = part.fndesc.llvm_func_name
        library = MachineCode(self.targetctx.codegen(), part.library.name)
        library.enable_object_caching()
        module = part.library.linked([name])
        relink(module, 'internal', but=[name])
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
    library = MachineCode(part.library.codegen, part.library.name)
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
