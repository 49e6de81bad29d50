"""Writes the lock: what pip would install today for every extra of setup.py.

Nothing is installed. Run it with the oldest Python that the lock has to serve, so that
packages which only older Pythons need are in it; newer ones just carry them along.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent

HEADERS = {
    'ros-wheels.txt': '# ROS 2 Jazzy as wheels. Not installed where a ROS 2 Jazzy is sourced.',
    'runtime.txt': '# What the package needs on a robot and for its reports, and its build.',
    'development.txt': '# What tests it, lints it and times it.',
}
BUILD = {'setuptools', 'wheel'}


def resolve(extras: str) -> dict[str, str]:
    """Asks pip what it would install.

    Args:
        extras: Of setup.py, separated by commas.

    Returns:
        Versions by canonical package name, without the package of this tree.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / 'report.json'
        command = [sys.executable, '-m', 'pip', 'install', '--quiet', '--dry-run']
        command += ['--ignore-installed', '--report', str(report)]
        command += [f'{HERE.parent}[{extras}]']
        subprocess.run(command, check=True)
        items = json.loads(report.read_text(encoding='utf-8'))['install']
    versions = {}
    for item in items:
        name = item['metadata']['name'].lower().replace('_', '-').replace('.', '-')
        versions[name] = item['metadata']['version']
    del versions['cmpsp-ros']
    return versions


def main() -> None:
    """Resolves, checks and writes the files."""
    versions = resolve('ros,solvers,report,test,lint')
    runtime = BUILD | set(resolve('ros,solvers,report'))
    if 'lark' in versions:
        sys.exit('lock: lark overwrites lark-parser, which ROS needs: drop what asks for it')
    texts = {name: [header, '# Written by `make lock`.'] for name, header in HEADERS.items()}
    for name in sorted(versions):
        ros = name.startswith('ros-') or name == 'lark-parser'
        file = 'ros-wheels.txt' if ros else 'runtime.txt' if name in runtime else 'development.txt'
        texts[file].append(f'{name}=={versions[name]}')
    for name, lines in texts.items():
        (HERE / name).write_text('\n'.join(lines) + '\n', encoding='utf-8')


if __name__ == '__main__':
    main()
