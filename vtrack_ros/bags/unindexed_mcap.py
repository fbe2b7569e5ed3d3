"""
MCAP files without an index of their messages.

Those of a recorder that died have complete records, but neither a summary nor an end. Others are
whole, but were written without chunks or without an index.

See the MCAP specification, https://mcap.dev/spec: a file is a sequence of records between two
magic marks; each begins with its kind (one byte) and its length (eight bytes). Messages are in
chunks or outside; the footer points to a summary at the end, of definitions, counts and chunks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
import os
from pathlib import Path
from struct import pack, unpack
from typing import BinaryIO

from rosbags.rosbag2.storage_mcap import decompress

from vtrack_ros.bags.file_view import FileView, Piece

_MARK = b'\x89MCAP0\r\n'
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _STATISTICS, _DATA_END = (
    0x02, 0x03, 0x04, 0x05, 0x06, 0x08, 0x0B, 0x0F)
#: Kinds that end the data. 0 is no valid kind, but unwritten parts of a file may be zeros.
_ENDS = (0x00, _FOOTER, _DATA_END)
#: Approximate size of the chunks made from records outside chunks, in bytes.
_CHUNK_SIZE = 1 << 20


def unindexed_mcap(path: Path) -> FileView | None:
    """
    Return a view of a file without an end: its complete records, with a summary and end added.

    None for a file that has an end, or isn't MCAP. If a chunk is broken and more messages follow,
    ValueError, or whatever decompression raises.
    """
    with path.open('rb') as file:
        begins = file.read(len(_MARK)) == _MARK
        size = file.seek(0, os.SEEK_END)
        if not begins or size == len(_MARK):
            return None
        file.seek(-len(_MARK), os.SEEK_END)
        return None if file.read() == _MARK else FileView(path, _Summarised(file, size).pieces)


def indexed_mcap(path: Path) -> FileView:
    """
    Return a view of a whole file with all messages in chunks, and an index of them.

    Without these rosbags reads messages only if they're in order, or not at all. If a part of the
    file is broken, ValueError, or whatever decompression raises.
    """
    with path.open('rb') as file:
        size = file.seek(0, os.SEEK_END)
        return FileView(path, _Summarised(file, size, whole=True).pieces)


@dataclass
class _Content:
    """Contents of records: definitions by (kind, id), message counts by channel, time range."""

    definitions: dict[tuple[int, int], bytes] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    first: int = 2**63 - 1
    last: int = 0

    def add(self, stream: BinaryIO, kind: int, start: int, end: int) -> None:
        """Take a record into account; of a message only the beginning is read."""
        if kind in (_SCHEMA, _CHANNEL):
            stream.seek(start)
            record = stream.read(end - start)
            self.definitions[kind, unpack('<H', record[9:11])[0]] = record
        elif kind == _MESSAGE:
            stream.seek(start + 9)
            channel, _, time = unpack('<HIQ', stream.read(14))
            self.counts[channel] += 1
            self.first, self.last = min(self.first, time), max(self.last, time)

    def merge(self, other: _Content) -> None:
        """Add the contents of other records."""
        self.definitions |= other.definitions
        self.counts += other.counts
        self.first, self.last = min(self.first, other.first), max(self.last, other.last)


class _Summarised:
    """The `pieces` of the view: those of a file without its end, and the end that's added."""

    def __init__(self, file: BinaryIO, size: int, whole: bool = False) -> None:
        self.pieces: list[Piece] = []
        self._length = 0        # of the pieces, in bytes
        self._taken = 0         # bytes of the file that are in pieces
        self._content = _Content()
        self._unchunked = _Content()
        self._indices: list[bytes] = []
        end = len(_MARK)
        broken: Exception | None = None
        for kind, start, end in _records(file, end, size):
            if broken is not None:
                if kind in (_MESSAGE, _CHUNK):
                    raise broken
                continue
            if kind in (_SCHEMA, _CHANNEL, _MESSAGE):
                self._unchunked.add(file, kind, start, end)
                if end - self._taken > _CHUNK_SIZE:
                    self._gather(end)
                continue
            self._gather(start)
            if kind == _CHUNK:
                try:
                    self._note_chunk(file, start, end)
                except Exception as error:
                    # Decompression may raise anything. Only the last chunk may be incomplete.
                    if whole:
                        raise
                    broken = error
                    continue
            self._keep(end)
        if broken is None:
            self._gather(end)
        file.seek(end)
        if whole and file.read(1) not in (bytes([_FOOTER]), bytes([_DATA_END])):
            raise ValueError('a record is longer than the file')
        self.pieces.append(self._end())

    def _keep(self, end: int) -> None:
        """Append the file's bytes up to `end`."""
        self.pieces.append(range(self._taken, end))
        self._length += end - self._taken
        self._taken = end

    def _gather(self, end: int) -> None:
        """Append bytes up to `end`, messages as a chunk: rosbags sorts only messages in chunks."""
        size = end - self._taken
        if self._unchunked.counts:
            header = pack('<BQQQQIIQ', _CHUNK, 40 + size, self._unchunked.first,
                          self._unchunked.last, size, 0, 0, size)
            self._index(self._unchunked, len(header) + size, b'', size, size)
            self.pieces.append(header)
            self._length += len(header)
        self._content.merge(self._unchunked)
        self._unchunked = _Content()
        self._keep(end)

    def _note_chunk(self, file: BinaryIO, start: int, end: int) -> None:
        """Take a chunk of the file into account."""
        file.seek(start + 9)
        *_, size, crc, letters = unpack('<QQQII', file.read(32))
        compression = file.read(min(letters, end - start))
        (packed,) = unpack('<Q', file.read(8))
        if file.tell() + packed > end:
            raise ValueError('a chunk is longer than its record')
        records = BytesIO(decompress(file.read(packed), compression.decode(), size, crc))
        content, reached = _Content(), 0
        for kind, begin, reached in _records(records, 0, size):
            content.add(records, kind, begin, reached)
        if reached != size:
            raise ValueError('a chunk ends in the middle of a record')
        self._content.merge(content)
        self._index(content, end - start, compression, packed, size)

    def _index(self, content: _Content, length: int, compression: bytes, packed: int,
               size: int) -> None:
        """Index the next chunk, as if each channel's message index followed it."""
        offsets, place = b'', self._length + length
        for channel, count in content.counts.items():
            # rosbags counts messages by the length of that index, and never reads it.
            offsets += pack('<HQ', channel, place)
            place += 15 + 16 * count
        self._indices.append(_record(
            _CHUNK_INDEX,
            pack('<QQQQ', content.first, content.last, self._length, length) + _sized(offsets) +
            pack('<Q', place - self._length - length) + _sized(compression) +
            pack('<QQ', packed, size)))

    def _end(self) -> bytes:
        content = self._content
        kinds = Counter(kind for kind, _ in content.definitions)
        statistics = pack(
            '<QHIIIIQQ', content.counts.total(), kinds[_SCHEMA], kinds[_CHANNEL], 0, 0,
            len(self._indices), content.first, content.last)
        counts = b''.join(pack('<HQ', *item) for item in content.counts.items())
        definitions = (record for _, record in sorted(content.definitions.items()))
        return b''.join((
            *definitions, _record(_STATISTICS, statistics + _sized(counts)), *self._indices,
            _record(_FOOTER, pack('<QQI', self._length, 0, 0)), _MARK))


def _records(stream: BinaryIO, place: int, size: int) -> Iterator[tuple[int, int, int]]:
    """Iterate over the complete records of the data: kind, start and end."""
    while place + 9 <= size:
        stream.seek(place)
        kind, length = unpack('<BQ', stream.read(9))
        end = place + 9 + length
        if kind in _ENDS or end > size:
            return
        yield kind, place, end
        place = end


def _record(kind: int, content: bytes) -> bytes:
    return pack('<BQ', kind, len(content)) + content


def _sized(content: bytes) -> bytes:
    return pack('<I', len(content)) + content
