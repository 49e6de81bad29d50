"""Rules of the house that no linter has: front doors, sizes of files and folders, docstrings."""

import ast
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
MAX_LINES = 350
MAX_FILES = 14
RELATIVE = re.compile(r'(What|Whatever|Whether|Of|As of|Its|How|Where|See|Which|Who|Whose|That)\b')


def room(module: str) -> str:
    """Package directly below `cmpsp_ros` that a module belongs to, '' for others."""
    first, _, rest = module.partition('.')
    return rest.partition('.')[0] if first == 'cmpsp_ros' else ''


def past_front_doors(path: Path) -> list[str]:
    """Imports from a module of another room; a room is entered through a package's `__init__`."""
    own = room('.'.join(path.relative_to(ROOT).with_suffix('').parts))
    return [
        f'{path.relative_to(ROOT)}:{node.lineno}: imports from module {node.module}; '
        'import from its package'
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        if isinstance(node, ast.ImportFrom) and node.module
        and room(node.module) not in {'', own}
        and (ROOT / f'{node.module.replace(".", "/")}.py').is_file()
        and node.module.count('.') > 1
    ]  # fmt: skip


def relative_openings(path: Path) -> list[str]:
    """Docstrings that open with a relative word; a noun or a verb of the field is expected."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            continue
        if isinstance(text := node.value.value, str) and (opening := RELATIVE.match(text)):
            place = f'{path.relative_to(ROOT)}:{node.lineno}'
            found.append(f'{place}: docstring opens with {opening[0]}; wanted a noun or a verb')
    return found


def main() -> int:
    """Print what breaks a rule; 1 if anything does."""
    found = []
    for top in ('cmpsp_ros', 'benchmarks', 'test'):
        files = sorted((ROOT / top).rglob('*.py'))
        for path in files:
            found += relative_openings(path)
            if top != 'test':
                found += past_front_doors(path)
            lines = len(path.read_text(encoding='utf-8').splitlines())
            if lines > MAX_LINES:
                found.append(f'{path.relative_to(ROOT)}: {lines} lines; at most {MAX_LINES}')
        for folder in sorted({path.parent for path in files}):
            count = sum(path.parent == folder for path in files if path.name != '__init__.py')
            if top == 'cmpsp_ros' and count > MAX_FILES:
                found.append(f'{folder.relative_to(ROOT)}: {count} files; at most {MAX_FILES}')
    print('\n'.join(found) or 'House rules kept.')  # noqa: T201 (a program's output)
    return bool(found)


if __name__ == '__main__':
    sys.exit(main())
