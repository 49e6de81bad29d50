"""The error of this room."""


class ProblemError(ValueError):
    """A problem, guess or setting the method cannot work with; the message names the argument."""
