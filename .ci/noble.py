"""Packages that Ubuntu 24.04 (noble) would refuse, and lower bounds that no test has tried."""

import ast
import re
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

ROOT = Path(__file__).parents[1]
PAGES = ('README.md', 'doc/user/install.md')


def read(name: str) -> str:
    """Text of a file of the repository."""
    return (ROOT / name).read_text(encoding='utf-8')


def lines(name: str) -> list[str]:
    """Packages of a file in requirements/, with their versions."""
    bare = (each.partition('#')[0].strip() for each in read(f'requirements/{name}').splitlines())
    return [each for each in bare if each and not each.startswith('-')]


def lower_bounds(constant: str) -> dict[str, str]:
    """Lower bounds in a constant of setup.py, by package."""
    for node in ast.walk(ast.parse(read('setup.py'))):
        if constant in (getattr(each, 'id', '') for each in getattr(node, 'targets', ())):
            texts = (each.value for each in ast.walk(node.value) if isinstance(each, ast.Constant))
            return dict(re.findall(r'^([\w.-]+)>=([\w.]+)', '\n'.join(texts), re.MULTILINE))
    raise LookupError(constant)


def main() -> int:
    """Print what noble refuses and what is not tested; 1 if there is anything."""
    keys = {node.text for node in ET.fromstring(read('package.xml')).iter('exec_depend')}  # noqa: S314
    known = set(lines('rosdep-noble.txt'))
    found = [f'package.xml: {each}: rosdep-noble.txt has none' for each in sorted(keys - known)]
    tested = dict(each.split('==') for name in ('noble.txt', 'oldest.txt') for each in lines(name))
    bounds = lower_bounds('INSTALL_REQUIRES')
    for package, version in {**bounds, **lower_bounds('EXTRAS_REQUIRE')}.items():
        if tested.get(package) != version:
            found.append(f'setup.py: {package}>={version}: tested is {tested.get(package)}')
    from_apt = re.findall(r'^(\S+)==.*# (\S+)$', read('requirements/noble.txt'), re.MULTILINE)
    there = {package for package, key in from_apt if key in keys} | {
        'llvmlite',
        *lines('robot.txt'),
    }
    found += [
        f'robot.txt: lacks {each}, which apt does not bring' for each in bounds.keys() - there
    ]
    found += [
        f'{page}: {line}: noble refuses pip outside of a virtual environment'
        for page in PAGES
        for line in re.findall(r'^\$ .*pip install.*', read(page), re.MULTILINE)
        if 'robot.txt' not in line or 'venv/bin/' not in line
    ]
    print('\n'.join(found) or 'Noble has all of it.')  # noqa: T201 (a program's output)
    return bool(found)


if __name__ == '__main__':
    sys.exit(main())
