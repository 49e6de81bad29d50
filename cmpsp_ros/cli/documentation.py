"""Pages of the site that derive from code: `python -m cmpsp_ros.cli.documentation FOLDER`."""

import sys
from importlib import import_module
from pathlib import Path
from typing import Final

import typer.main

from cmpsp_ros.cli import app

_PACKAGES: Final = ('mpsp', 'robots', 'world', 'guidance')


def commands_page() -> str:
    """Help of every command, in Markdown."""
    parts = ['# Commands\n\n[Exit codes](exit_codes.md) are listed apart.\n']
    for name, command in typer.main.get_group(app).commands.items():
        with command.make_context(f'cmpsp {name}', [], resilient_parsing=True) as context:
            parts.append(f'## cmpsp {name}\n\n```text\n{command.get_help(context)}\n```\n')
    return '\n'.join(parts)


def package_page(name: str) -> str:
    """Names that a package offers, as directives for mkdocstrings."""
    package = import_module(f'cmpsp_ros.{name}')
    homes = {each: getattr(getattr(package, each), '__module__', '') for each in package.__all__}
    offered = [f'::: {home}.{each}' for each, home in homes.items() if home.startswith('cmpsp_ros')]
    return '\n\n'.join([f'# cmpsp_ros.{name}', package.__doc__ or '', *offered, ''])


def main() -> None:
    """Write the pages into a folder."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in {
        'commands.md': commands_page(),
        **{f'{each}.md': package_page(each) for each in _PACKAGES},
    }.items():
        (folder / name).write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main()
