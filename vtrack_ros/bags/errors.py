"""Errors about recorded frames; their messages name the file, the cause and the remedy."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import sqlite3


class SequenceError(ValueError):
    """Recorded frames or their truth can't be read or used."""


class BagError(SequenceError):
    """A bag can't be read or written."""


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Raise BagError with `path` for system errors that name no file, such as a full disk."""
    try:
        yield
    except (OSError, sqlite3.Error) as error:
        if getattr(error, 'filename', None) is not None:
            raise
        reason = getattr(error, 'strerror', None) or error
        raise BagError(f"can't write {path}: {reason}") from error


def check_output(path: Path) -> None:
    """Raise BagError if a file can't be written, before work that would be in vain."""
    try:
        if path.is_dir():
            raise BagError(f'{path} is a folder, not a file')
        if path.is_file():
            path.open('ab').close()
        elif not path.exists():
            file = path.resolve()
            if not file.parent.is_dir():
                raise BagError(f'there is no folder {file.parent}')
            file.touch()
            file.unlink()
    except OSError as error:
        raise BagError(f"can't write {path}: {error.strerror}") from error
