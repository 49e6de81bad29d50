"""The error of this package."""


class DemoError(RuntimeError):
    """A run could not be started or did not end; the message says why."""
