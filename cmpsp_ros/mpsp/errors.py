"""The error of this package."""


class ProblemError(ValueError):
    """A problem, guess or setting the method cannot work with; the message names the argument."""
