"""Errors of this package."""


class BagError(Exception):
    """A bag cannot be read or written; the message names the file, what was found and wanted."""


class UnknownTypeError(BagError):
    """A topic cannot be recorded because nothing here defines its message type."""
