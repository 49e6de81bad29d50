"""Problems of a set of parameters, worded for the user."""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

T = TypeVar('T')


class Problem(NamedTuple):
    """One problem: the parameter's key, or file and line; the value found; the value wanted."""

    where: str
    found: str
    wanted: str

    def __str__(self) -> str:
        return f'{self.where}: found {self.found}, wanted {self.wanted}'


class ParameterError(ValueError):
    """An invalid set of parameters; its message has one line for each of its `problems`."""

    def __init__(self, *problems: Problem) -> None:
        super().__init__(*problems)
        self.problems = problems

    def __str__(self) -> str:
        return '\n'.join(map(str, self.problems))


class Problems(list[Problem]):
    """Problems collected while the things that a set describes are made, each once."""

    def attempt(self, make: Callable[[], T]) -> T | None:
        """Make a thing; None where it cannot be made, which is noted."""
        try:
            return make()
        except ParameterError as error:
            self.extend(error.problems)
            return None

    def check(self) -> None:
        """Raise a ParameterError with all problems, if there are any."""
        if self:
            raise ParameterError(*self)


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
