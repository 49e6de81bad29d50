"""The error of this room."""


class BenchError(RuntimeError):
    """A benchmark that cannot be made as asked; the message says what was found and wanted."""
