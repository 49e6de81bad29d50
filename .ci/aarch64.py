"""`cmpsp warmup`, a study, a replay and examples on an emulated aarch64, beside this machine.

``.venv/bin/python .ci/aarch64.py FOLDER``, with ``apt install debootstrap proot qemu-user-static``.
It takes half an hour, most of it to compile; the same command continues what was interrupted.
"""

import json
import math
import re
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[1]
DEBIAN = 'http://deb.debian.org/debian'
NO_WHEEL = ('empy',)  # which only ROS needs
CLI = ('-m', 'cmpsp_ros.cli')
PAGES = ('first_problem', 'regulator', 'tracking')  # whose code is run, in doc/method/
STUDY = (*CLI, 'study', 'nominal', '--runs', '20', '--seed', '1', '--output')


def make_root(root: Path) -> None:
    """Unpack Debian with Python for arm64; nothing of it is run before it is complete."""
    if (root / 'usr/bin/python3').exists():
        return
    choice = ['--arch=arm64', '--variant=minbase', '--include=python3,libgomp1']
    subprocess.run(['debootstrap', '--foreign', *choice, 'bookworm', root, DEBIAN], check=True)
    for package in sorted((root / 'var/cache/apt/archives').glob('*.deb')):
        files = subprocess.run(
            ['dpkg-deb', '--fsys-tarfile', package], capture_output=True, check=True
        )
        unpack = ['tar', '-x', '-f', '-', '-C', root, '--keep-directory-symlink']
        subprocess.run(unpack, input=files.stdout, check=True)


def add_wheels(folder: Path) -> None:
    """Unpack wheels for aarch64 and Debian's Python: requirements/runtime.txt, and CasADi."""
    if folder.exists():
        return
    runtime, development = (
        (SOURCE / f'requirements/{each}.txt').read_text(encoding='utf-8').splitlines()
        for each in ('runtime', 'development')
    )
    wanted = [each for each in runtime if '==' in each and not each.startswith(NO_WHEEL)]
    wanted += [each for each in development if each.startswith('casadi==')]
    platforms = [f'--platform=manylinux_2_{each}_aarch64' for each in (17, 24, 26, 27, 28)]
    choice = ['--python-version=3.11', '--only-binary=:all:', *platforms]
    pip = [sys.executable, '-m', 'pip', 'install', '--no-deps', '--no-compile', '--quiet']
    subprocess.run([*pip, '--target', folder, *choice, *wanted], check=True)


def printed(*command: str | Path, env: dict[str, str] | None = None) -> str:
    """Run a command, and return what it prints; CalledProcessError if it fails."""
    return subprocess.check_output(command, cwd=SOURCE, env=env, text=True)


def here(*arguments: str | Path) -> str:
    """Run Python on this machine, and return what it prints."""
    return printed(sys.executable, *arguments)


def there(folder: Path, *arguments: str | Path) -> str:
    """Run Python on aarch64, in a root of its own, and return what it prints."""
    kept = {'PATH': '/usr/bin:/bin', 'HOME': str(folder), 'PYTHONPATH': f'{SOURCE}:/wheels'}
    kept |= {'XDG_CACHE_HOME': str(folder / 'cache'), 'PYTHONDONTWRITEBYTECODE': '1'}
    seen = [word for each in ('/dev', SOURCE, folder) for word in ('-b', each)]
    emulator = ['proot', '-q', 'qemu-aarch64-static', '-r', folder / 'root', *seen, '-w', SOURCE]
    return printed(*emulator, '/usr/bin/python3', *arguments, env=kept)


def tell(text: str) -> None:
    """Print a text at once."""
    sys.stdout.write(f'{text}\n')
    sys.stdout.flush()


def code_of(page: str) -> str:
    """Python of a page."""
    text = (SOURCE / 'doc/method' / f'{page}.md').read_text(encoding='utf-8')
    return '\n'.join(re.findall(r'```python\n(.*?)```', text, re.DOTALL))


def difference(one: object, other: object) -> float:
    """Largest difference of the numbers in two values of JSON; infinite where they differ else."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return max((difference(one[each], other[each]) for each in one), default=0.0)
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return max(map(difference, one, other), default=0.0)
    if isinstance(one, float) and isinstance(other, float):
        return 0.0 if one == other else abs(one - other)
    return 0.0 if one == other else math.inf


def runs(path: Path) -> dict[int, dict[str, object]]:
    """Outcomes of a study by the numbers of its runs."""
    lines = filter(None, path.read_text(encoding='utf-8').splitlines())
    found = (each for each in map(json.loads, lines) if 'number' in each)
    return {each['number']: each for each in found}


def compared(folder: Path) -> str:
    """Largest difference of each figure of the study."""
    one, other = (runs(folder / each / 'runs.jsonl') for each in ('here', 'there'))
    both = sorted(one.keys() & other.keys())
    differences = {
        key: max(difference(one[each][key], other[each][key]) for each in both)
        for key in one[both[0]]
    }
    return '\n'.join([f'{len(both)} runs', *(f'{k}: {v:.1e}' for k, v in differences.items())])


def main(folder: Path) -> int:
    """Run everything on both; 1 if a page prints something else, or CalledProcessError."""
    make_root(folder / 'root')
    add_wheels(folder / 'root/wheels')
    tell(there(folder, *CLI, 'warmup'))
    others = []
    for page in PAGES:
        is_same = here('-c', code_of(page)) == there(folder, '-c', code_of(page))
        tell(f'{page}: {"the same" if is_same else "other"} output')
        others += [page] * (not is_same)
    here(*CLI, 'demo', 'case3', '--lockstep', '--force', '--output', folder / 'case3')
    tell(there(folder, *CLI, 'replay', '--tolerance', '1e-9', folder / 'case3/bag'))
    here(*STUDY, folder / 'here')
    there(folder, *STUDY, folder / 'there')
    tell(compared(folder))
    return int(bool(others))


if __name__ == '__main__':
    sys.exit(main(Path(sys.argv[1]).resolve()))
