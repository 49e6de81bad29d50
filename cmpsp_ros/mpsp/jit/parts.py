"""Kernels in parts: a function is translated once, and optimised with all that it calls.

Numba optimises a function and makes machine code of it as soon as another one calls it, and does so
again, as a part of its caller, at each level of calls. Here a function that others call stays
bitcode. What Python calls, or asks the address of, is linked from such parts, optimised as a whole
and made machine code of, once.
"""

from collections.abc import Iterable, Iterator
from copy import copy
from typing import Any, Final

from llvmlite import binding
from numba.core import cgutils, typing
from numba.core.codegen import JITCodeLibrary
from numba.core.environment import lookup_environment

from cmpsp_ros.mpsp.jit.lowering import passed
from cmpsp_ros.mpsp.jit.sizes import with_sizes, with_symbols

_ENVIRONMENT = '_ZN08NumbaEnv'
_DYNAMIC = 'numba.dynamic.globals'
# Linkage of functions that are in several modules, and dropped where nothing calls them.
_MANY = 'linkonce_odr'


_LEVEL: Final = 3  # level of optimisation
# LLVM's cost up to which a function is put into its callers; 225, its default, compiles longer.
_INLINED: Final = 100


class MachineCode(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """Numba's library of a kernel with all that it calls, optimised as a whole, once."""

    def _optimize_final_module(self) -> None:
        # Numba does so twice, to take out counts of references in between.
        options = binding.create_pipeline_tuning_options(_LEVEL)
        options.loop_vectorization = options.loop_interleaving = True
        options.slp_vectorization, options.inlining_threshold = False, _INLINED
        builder = binding.create_pass_builder(self._codegen._tm, options)  # noqa: SLF001
        builder.getModulePassManager().run(self._final_module, builder)


class Part(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """Bitcode of a function; with that of all it calls if it comes from a file.

    Args:
        codegen: Numba's code generator.
        name: Name of the function.
        bitcode: Content of a file; it is parsed when something is linked with it.
        is_general: Its code is for records of all sizes.
    """

    bitcode: bytes | None = None  # content of a file that has not been parsed
    # Machine code of the function and all that it calls, until it is loaded.
    machine_code: bytes | None = None
    # Numba's `Environment` of it and of all that it calls, where they come from a file.
    environments: tuple[Any, ...] = ()

    def __init__(
        self, codegen: Any, name: str, bitcode: bytes | None = None, *, is_general: bool = False
    ) -> None:
        super().__init__(codegen, name)
        self.bitcode, self._shared_module = bitcode, None
        self._is_general = is_general

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
        text = cgutils.normalize_ir_text(str(ir_module))
        module = binding.parse_assembly(with_symbols(text) if self._is_general else text)
        module.name = ir_module.name
        module.verify()
        self.add_llvm_module(module)
        relink(self._own, _MANY)

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
            relink(self._shared_module, _MANY)
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


class Sized(Part):
    """A part for records of one size; it has nothing but machine code of its own.

    Args:
        part: Numba's result for the general function.
        name: Name of the function for this size.
        sizes: ``n`` and ``r``.
    """

    def __init__(self, part: Any, name: str, sizes: tuple[int, int]) -> None:
        super().__init__(part.library.codegen, part.library.name)
        self._part, self._name, self._sizes = part, name, sizes

    def _get_module_for_linking(self) -> Any:
        return self._part.library._get_module_for_linking()  # noqa: SLF001 (numba's name)

    def linked(self, _names: Iterable[str]) -> Any:
        """The function with everything that it calls, in one module."""
        name = self._part.fndesc.llvm_func_name
        module = with_sizes(self._part.library.linked([name]), *self._sizes)
        module.get_function(name).name = self._name
        return module


def for_sizes(part: Any, signature: tuple[Any, ...], sizes: tuple[int, int]) -> Any:
    """Numba's result for one size, from the general one."""
    description = copy(part.fndesc)
    description.argtypes = passed(signature)
    description.mangled_name += '.{}.{}'.format(*sizes)
    library = Sized(part, description.llvm_func_name, sizes)
    own = typing.signature(part.signature.return_type, *signature)
    return part._replace(fndesc=description, library=library, signature=own)


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


def relink(module: Any, linkage: str, but: Iterable[str] = ()) -> None:
    """Change the linkage of the functions in a module."""
    for each in module.functions:
        if not each.is_declaration and each.linkage.name != 'internal' and each.name not in but:
            each.linkage = linkage


def environments_in(module: Any) -> tuple[Any, ...]:
    """Numba's `Environment` of each function in a module."""
    names = [each.name for each in module.global_variables]
    found = [lookup_environment(each) for each in names if each.startswith(_ENVIRONMENT)]
    return tuple(each for each in found if each is not None and each.can_cache())


def is_constant(module: Any) -> bool:
    """True for a module without addresses of this process."""
    return not any(each.name.startswith(_DYNAMIC) for each in module.global_variables)
