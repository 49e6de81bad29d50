"""The pages in ``doc/`` run, print what they say they print, and link to what is there."""

import io
import re
import traceback
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PAGES = [*sorted((ROOT / 'doc').rglob('*.md')), ROOT / 'CONTRIBUTING.md']
LINKING = [*PAGES, ROOT / 'README.md']

_FENCE = re.compile(r'^```(\w*)\n(.*?)^```$', re.MULTILINE | re.DOTALL)
_LINK = re.compile(r'\]\(([^)\s]+)\)')


@dataclass
class Block:
    """A fenced block: its language, its text and the page's line on which the text begins."""

    language: str
    text: str
    line: int


@dataclass
class Run:
    """Everything the Python blocks of a page share."""

    page: str
    namespace: dict = field(default_factory=lambda: {'__name__': 'page'})

    def execute(self, block):
        """Output of a block; fails with the page's name and the line where it breaks."""
        # Blank lines before it give the block the line numbers of its page.
        source = '\n' * (block.line - 1) + block.text
        printed = io.StringIO()
        try:
            with redirect_stdout(printed):
                exec(compile(source, self.page, 'exec'), self.namespace)
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            lines = [frame.lineno for frame in frames if frame.filename == self.page]
            if isinstance(error, SyntaxError):
                lines.append(error.lineno)
            pytest.fail(f'{self.page}, line {lines[-1]}: {error!r}')
        return printed.getvalue()


def blocks_of(text):
    return [
        Block(match[1], match[2], text.count('\n', 0, match.start(2)) + 1)
        for match in _FENCE.finditer(text)
    ]


def check(page, text):
    run, printed = Run(page), ''
    for block in blocks_of(text):
        if block.language == 'python':
            printed += run.execute(block)
        elif block.language == 'text':
            where = f'{page}, line {block.line}'
            assert printed == block.text, f'{where}: printed\n{printed}instead of\n{block.text}'
            printed = ''
    assert not printed, f'{page}: printed at its end, with no text block\n{printed}'


def links_of(text):
    targets = (match[1] for match in _LINK.finditer(_FENCE.sub('', text)))
    return [target for target in targets if not re.match(r'[a-z]+:|#', target)]


# Its own problem is compiled: a minute.
SLOW = {'kernels.md'}


@pytest.mark.parametrize(
    'page',
    [
        pytest.param(page, marks=[pytest.mark.slow] * (page.name in SLOW), id=page.name)
        for page in PAGES
    ],
)
def test_page_prints_what_it_says(page):
    check(page.relative_to(ROOT).as_posix(), page.read_text(encoding='utf-8'))


@pytest.mark.parametrize('page', LINKING, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_point_at_files(page):
    links = links_of(page.read_text(encoding='utf-8'))
    missing = [link for link in links if not (page.parent / link.split('#')[0]).exists()]
    assert not missing, f'{page.relative_to(ROOT)}: no file for {missing}'


# A command writes this one, a paragraph a line.
WRITTEN = {'performance.md'}


@pytest.mark.parametrize('page', LINKING, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_prose_is_at_most_120_columns_wide(page):
    prose = _FENCE.sub('', page.read_text(encoding='utf-8')).splitlines()
    wide = [line for line in prose if len(line) > 120 and not line.startswith(('|', '!['))]
    assert page.name in WRITTEN or not wide


def test_every_page_is_in_the_index():
    index = ROOT / 'doc' / 'README.md'
    linked = links_of(index.read_text(encoding='utf-8'))
    pages = {page.relative_to(ROOT / 'doc').as_posix() for page in PAGES[:-1]} - {index.name}
    assert pages == {link for link in linked if link.endswith('.md') and link[:2] != '..'}


def test_every_page_is_in_the_menu_of_the_site():
    menu = str(yaml.safe_load((ROOT / 'mkdocs.yml').read_text(encoding='utf-8'))['nav'])
    missing = [page for page in PAGES if f"'{page.relative_to(ROOT).as_posix()}'" not in menu]
    assert not missing


@pytest.mark.parametrize('page', LINKING, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_fields_that_are_echoed_are_known_to_ros2cli_of_jazzy(page):
    """0.32 takes names between dots; elements of arrays came with 0.38."""
    fields = re.findall(r'ros2 topic echo .*--field[ =](\S+)', page.read_text(encoding='utf-8'))
    assert all(re.fullmatch(r'\w+(\.\w+)*', each) for each in fields)
