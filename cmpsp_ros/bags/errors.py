"""Errors of this package."""


class BagError(Exception):
    """A bag cannot be read or written; the message names file, finding and requirement."""


class UnknownTypeError(BagError):
    """A topic cannot be recorded because nothing here defines its message type."""
