"""What can go wrong when back ends are verified."""


class VerifyError(Exception):
    """What was asked for cannot be done; the message says what was found and what was wanted."""
