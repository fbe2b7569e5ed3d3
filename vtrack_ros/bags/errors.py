"""What goes wrong with recorded frames; a message says which, why, and what would do."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import sqlite3


class SequenceError(ValueError):
    """Recorded frames or their truth that can't be read or used."""


class BagError(SequenceError):
    """A bag that can't be read or written."""


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Say that it's `path` that can't be written, where the system only says why (a full disk)."""
    try:
        yield
    except (OSError, sqlite3.Error) as error:
        if getattr(error, 'filename', None) is not None:
            raise
        reason = getattr(error, 'strerror', None) or error
        raise BagError(f"can't write {path}: {reason}") from error
