"""A read-only view of a file with some bytes replaced or added, without copying or writing."""

from bisect import bisect_right
from collections.abc import Sequence
import io
from itertools import accumulate
import os
from pathlib import Path, PurePath
from typing import Any, BinaryIO, Self

#: What a view is made of: bytes of its own, or a range of the file's bytes.
Piece = bytes | range


class FileView:
    """
    The concatenated pieces of a file, to be read as one file.

    rosbags' readers take it as a path: it's a `rosbags.interfaces.typing.RPath`.
    """

    def __init__(self, path: Path, pieces: Sequence[Piece]) -> None:
        self._path = path
        self._pieces = [piece for piece in pieces if piece]

    def __str__(self) -> str:
        """Return the path of the file."""
        return str(self._path)

    def __truediv__(self, key: Self | PurePath | str) -> Self:
        """Raise NotADirectoryError."""
        raise NotADirectoryError(f'{self} is no folder: {key}')

    @property
    def stem(self) -> str:
        """Return the name without its suffix."""
        return self._path.stem

    @property
    def suffix(self) -> str:
        """Return the suffix with its dot."""
        return self._path.suffix

    def exists(self) -> bool:
        """Return whether the file is there."""
        return self._path.exists()

    def is_dir(self) -> bool:
        """Return False, for it's a file."""
        return False

    def stat(self, *, follow_symlinks: bool = True) -> os.stat_result:
        """Return the status of the underlying file."""
        return self._path.stat(follow_symlinks=follow_symlinks)

    def read_text(self, encoding: str | None = None) -> str:
        """Return all of it as text."""
        with self.open() as file:
            return file.read().decode(encoding or 'utf-8')

    def open(self, *_: Any, **__: Any) -> BinaryIO:  # noqa: A003
        """Open it for reading bytes, whatever the arguments."""
        return io.BufferedReader(_Pieces(self._path, self._pieces))


class _Pieces(io.RawIOBase):
    """The raw stream that `FileView.open` buffers."""

    def __init__(self, path: Path, pieces: Sequence[Piece]) -> None:
        self._file = path.open('rb', buffering=0)
        self._pieces = pieces
        self._starts = list(accumulate(map(len, pieces), initial=0))
        self._place = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        place = (0, self._place, self._starts[-1])[whence] + offset
        if place < 0:
            raise ValueError(f'there is no byte {place}')
        self._place = place
        return place

    def readinto(self, buffer: Any) -> int:
        if self._place >= self._starts[-1]:
            return 0
        number = bisect_right(self._starts, self._place) - 1
        rest = self._pieces[number][self._place - self._starts[number]:][:len(buffer)]
        if isinstance(rest, range):
            self._file.seek(rest.start)
            rest = self._file.read(len(rest))
        buffer[:len(rest)] = rest
        self._place += len(rest)
        return len(rest)

    def close(self) -> None:
        self._file.close()
        super().close()
