"""What goes wrong with bags."""


class BagError(ValueError):
    """A bag that can't be read or written; the message says which, why, and what would do."""
