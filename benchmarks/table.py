"""A table of text, for the terminal and for a page alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from rich.markup import escape
from rich.table import Table as RichTable


@dataclass(frozen=True)
class Table:
    """A part of the results.

    Attributes:
        title: Its heading.
        columns: Their names.
        rows: Cells as text.
        note: What a reader has to know.
        words: How many columns, from the first on, hold words and not numbers.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ''
    words: int = 1

    def markdown(self) -> str:
        """With its title as a heading and its note before it."""
        lines = [
            self.columns,
            ['---' if place < self.words else '---:' for place in range(len(self.columns))],
            *self.rows,
        ]
        body = '\n'.join('| ' + ' | '.join(line) + ' |' for line in lines)
        return '\n\n'.join(part for part in (f'## {self.title}', self.note, body) if part)

    def rich(self) -> RichTable:
        """For the terminal, without the note."""
        # Units stand in brackets, which is how rich marks its styles.
        table = RichTable(title=escape(self.title))
        for place, column in enumerate(self.columns):
            side: Literal['left', 'right'] = 'left' if place < self.words else 'right'
            table.add_column(escape(column), justify=side, overflow='fold')
        for row in self.rows:
            table.add_row(*map(escape, row))
        return table
