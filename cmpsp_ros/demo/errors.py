"""The error of this room."""


class DemoError(RuntimeError):
    """A run that could not be made or came to no end; the message says why."""
