"""What keeps a view from being shown."""


class ViewError(ValueError):
    """The view cannot be served; the message says where, what was found and what is wanted."""
