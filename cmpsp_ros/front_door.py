"""Front doors: packages that offer names from their modules, each imported when first asked for."""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path


def lazy_exports(package: str, file: str) -> tuple[Callable[[str], object], list[str]]:
    """`__getattr__` and `__all__` of a package with its imports under `TYPE_CHECKING` (PEP 562).

    Args:
        package: `__name__` of the package.
        file: `__file__` of the package.
    """
    homes = {
        alias.name: node.module
        for block in ast.parse(Path(file).read_text(encoding='utf-8')).body
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }

    def find(name: str) -> object:
        if name not in homes:
            raise AttributeError(f'module {package!r} has no attribute {name!r}')
        value = getattr(import_module(homes[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return find, sorted(homes)
