"""Problems of a set of parameters, worded for the user."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Problem:
    """One problem.

    Attributes:
        where: The parameter's key, or the file and line.
        found: The value found.
        wanted: The value expected.
    """

    where: str
    found: str
    wanted: str

    def __str__(self) -> str:
        """The problem in one line."""
        return f'{self.where}: found {self.found}, wanted {self.wanted}'


class ParameterError(ValueError):
    """An invalid set of parameters; its message has one line for each problem.

    Attributes:
        problems: All problems of the set, at least one.
    """

    def __init__(self, *problems: Problem) -> None:
        super().__init__(*problems)
        self.problems = problems

    def __str__(self) -> str:
        """One line for each problem."""
        return '\n'.join(str(problem) for problem in self.problems)


def describe(value: object) -> str:
    """A value as a user would write it, in one line of bounded length."""
    if value is None:
        return 'nothing'
    if isinstance(value, bool):
        return 'true' if value else 'false'
    try:
        text = ' '.join(repr(value).split())
    except Exception:
        # An error message must not fail for want of a repr.
        return f'a value of type {type(value).__name__}'
    return text if len(text) <= 80 else f'{text[:77]}...'
