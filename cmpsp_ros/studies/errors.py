"""The error of this package."""


class StudyError(ValueError):
    """A study cannot be run as requested; the message says what was found and what was expected."""
