"""What goes wrong with recorded frames; a message says which, why, and what would do."""


class SequenceError(ValueError):
    """Recorded frames or their truth that can't be read or used."""


class BagError(SequenceError):
    """A bag that can't be read or written."""
