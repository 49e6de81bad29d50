"""The error of this room."""


class StudyError(ValueError):
    """A study that cannot be made as asked; the message says what was found and what is wanted."""
