"""
ROS 1 bags whose recorder died: chunks of messages, but no index of them.

See the bag format 2.0, https://wiki.ros.org/Bags/Format/2.0: a record is a header of named fields
and data, each preceded by its length (four bytes). Connections and messages are in chunks; each
chunk is followed by its index. At the end come all connections and a list of the chunks, whose
position is in the first record. A recorder writes the length of a chunk when it closes it.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from io import BytesIO
import os
from pathlib import Path
import struct
from struct import pack, unpack, unpack_from
from typing import BinaryIO

from rosbags.rosbag1.reader import decompressors

from vtrack_ros.bags.file_view import FileView, Piece

_MARK = b'#ROSBAG V2.0\n'
_MESSAGE, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = b'\x02', b'\x04', b'\x05', b'\x06', b'\x07'
#: Upper bound of a header's length, in bytes: valid ones have a few short fields.
_LONGEST_HEADER = 1 << 16


def unindexed_ros1(path: Path) -> FileView | None:
    """
    Return a view of a bag without an index: its complete chunks, with an index added.

    Of a last chunk that was never closed it has the complete messages, unless it's compressed.
    None for a bag that has an index, or isn't one. If a chunk before the last is broken,
    ValueError, or whatever decompression raises.
    """
    with path.open('rb') as file:
        if file.read(len(_MARK)) != _MARK:
            return None
        header = _record_at(file, len(_MARK))
        if (header is None or header.fields.get(b'index_pos') != bytes(8)
                or header.fields.get(b'encryptor')):
            return None
        return FileView(path, _Indexed(file, header).pieces)


@dataclass(frozen=True)
class _Record:
    """The fields of a record's header; where record, data and the next record begin [bytes]."""

    fields: dict[bytes, bytes]
    start: int
    data: int
    end: int


@dataclass
class _Chunk:
    """
    A chunk that begins at `start`, its data at `data`; they end at `end`.

    `entries` are its index by connection, 12 bytes a message: time, and offset in the data.
    """

    start: int
    data: int
    end: int
    entries: dict[bytes, bytes] = field(default_factory=dict)

    def times(self) -> list[bytes]:
        """Return the times of the first and the last message."""
        found = [entries[place:place + 8] for entries in self.entries.values()
                 for place in range(0, len(entries), 12)]
        return [choice(found, key=lambda time: unpack('<II', time)) for choice in (min, max)]


class _Indexed:
    """The `pieces` of the view: those of a bag without an index, and the index that's added."""

    def __init__(self, file: BinaryIO, header: _Record) -> None:
        self._file = file
        self._size = file.seek(0, os.SEEK_END)
        self._connections: dict[bytes, bytes] = {}
        self._index_fields: tuple[bytes, ...] = (b'op', b'ver', b'conn', b'count')
        chunks = self._chunks(header.end)
        infos = b''.join(map(_chunk_info, chunks))
        index = self._index(chunks[-1]) if chunks else b''
        last = chunks[-1].end if chunks else header.end
        changed = {b'index_pos': pack('<Q', last + len(index)),
                   b'conn_count': pack('<I', len(self._connections)),
                   b'chunk_count': pack('<I', len(chunks))}
        file.seek(0)
        begin = file.read(header.data)
        for name, value in changed.items():
            begin = begin.replace(name + b'=' + header.fields[name], name + b'=' + value)
        self.pieces: list[Piece] = [begin]
        if chunks:
            data = chunks[-1].data
            self.pieces += [range(header.data, data - 4), pack('<I', last - data),
                            range(data, last), index, *self._connections.values(), infos]

    def _chunks(self, place: int) -> list[_Chunk]:
        """Return the chunks that have messages."""
        chunks = []
        broken: Exception | None = None
        while (record := _record_at(self._file, place)) is not None:
            kind = record.fields.get(b'op')
            if kind == _INDEX:
                # rosbags expects one order of the fields in all index records of a bag.
                self._index_fields = tuple(record.fields)
            elif kind != _CHUNK:
                break
            elif broken is not None:
                raise broken
            else:
                try:
                    chunk = self._chunk(record)
                except Exception as error:
                    # Decompression may raise anything. Only the last chunk may be incomplete.
                    broken = error
                else:
                    if chunk.entries:
                        chunks.append(chunk)
                    if chunk.end != record.end:
                        break
            place = record.end
        return chunks

    def _chunk(self, record: _Record) -> _Chunk:
        chunk = _Chunk(record.start, record.data, record.end)
        compression = record.fields[b'compression'].decode()
        closed = record.data < record.end <= self._size
        if compression == 'none' and not closed:
            chunk.end = self._read(chunk, self._file, record.data, self._size)
            return chunk
        if not closed:
            raise ValueError('a compressed chunk is not whole')
        if compression == 'none':
            stream, begin, end = self._file, record.data, record.end
        else:
            self._file.seek(record.data)
            data = decompressors[compression](self._file.read(record.end - record.data))
            stream, begin, end = BytesIO(data), 0, len(data)
        if self._read(chunk, stream, begin, end) != end:
            raise ValueError('a chunk ends in the middle of a record')
        return chunk

    def _read(self, chunk: _Chunk, stream: BinaryIO, begin: int, end: int) -> int:
        """Collect the complete connections and messages of a chunk; return where they end."""
        place = begin
        entries: dict[bytes, list[bytes]] = {}
        while (record := _record_at(stream, place)) is not None and record.end <= end:
            kind = record.fields.get(b'op')
            if kind == _CONNECTION:
                stream.seek(place)
                self._connections.setdefault(
                    record.fields[b'conn'], stream.read(record.end - place))
            elif kind == _MESSAGE:
                entries.setdefault(record.fields[b'conn'], []).append(
                    record.fields[b'time'] + pack('<I', place - begin))
            else:
                break
            place = record.end
        chunk.entries = {connection: b''.join(rows) for connection, rows in entries.items()}
        return place

    def _index(self, chunk: _Chunk) -> bytes:
        """Return the index that follows a chunk."""
        index = b''
        for connection, entries in chunk.entries.items():
            fields = {b'op': _INDEX, b'ver': pack('<I', 1), b'conn': connection,
                      b'count': pack('<I', len(entries) // 12)}
            index += _record(((name, fields[name]) for name in self._index_fields), entries)
        return index


def _chunk_info(chunk: _Chunk) -> bytes:
    first, last = chunk.times()
    counts = b''.join(connection + pack('<I', len(entries) // 12)
                      for connection, entries in chunk.entries.items())
    return _record(((b'op', _CHUNK_INFO), (b'ver', pack('<I', 1)),
                    (b'chunk_pos', pack('<Q', chunk.start)), (b'start_time', first),
                    (b'end_time', last), (b'count', pack('<I', len(chunk.entries)))), counts)


def _record_at(stream: BinaryIO, start: int) -> _Record | None:
    """Return the record at `start`, maybe cut off; None if its header is incomplete."""
    stream.seek(start)
    try:
        (length,) = unpack('<I', stream.read(4))
        if length > _LONGEST_HEADER:
            return None
        fields = _fields(stream.read(length))
        (size,) = unpack('<I', stream.read(4))
    except struct.error:
        return None
    data = start + 4 + length + 4
    return _Record(fields, start, data, data + size)


def _fields(header: bytes) -> dict[bytes, bytes]:
    fields, place = {}, 0
    while place < len(header):
        (length,) = unpack_from('<I', header, place)
        name, _, value = header[place + 4:place + 4 + length].partition(b'=')
        fields[name] = value
        place += 4 + length
    return fields


def _record(fields: Iterable[tuple[bytes, bytes]], data: bytes) -> bytes:
    header = b''.join(pack('<I', len(name) + 1 + len(value)) + name + b'=' + value
                      for name, value in fields)
    return pack('<I', len(header)) + header + pack('<I', len(data)) + data
