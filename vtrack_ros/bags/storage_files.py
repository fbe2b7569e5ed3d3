"""The files of a bag, and the rosbags reader for each."""

from pathlib import Path

from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.rosbag2.storage_mcap import McapReader

from vtrack_ros.bags.errors import BagError
from vtrack_ros.bags.image_folder import by_number
from vtrack_ros.bags.unindexed_mcap import indexed_mcap, unindexed_mcap
from vtrack_ros.bags.unindexed_ros1 import unindexed_ros1

#: rosbags' reader of a folder with metadata, or of a file.
Storage = Ros1Reader | Ros2Reader


def storage_files(path: Path) -> list[Path]:
    """
    Return what a bag is read from: `path`, or the sorted files of a folder without metadata.

    BagError if `path` isn't a bag by its name, or the folder's files can't be read as one bag.
    """
    if path.is_dir():
        return [path] if (path / 'metadata.yaml').is_file() else _files_in(path)
    if not path.exists():
        raise BagError(f'{path} does not exist')
    if path.suffix == '.zstd':
        raise BagError(f'{path} is compressed: give the folder of the bag, with its '
                       'metadata.yaml, instead of this file')
    if not path.name.endswith(('.mcap', '.db3', '.bag', '.bag.active')):
        raise BagError(f'{path} is not a bag: it must be a rosbag2 folder or a .mcap, .db3 or '
                       '.bag file')
    if path.stat().st_size == 0:
        raise BagError(f'{path} is empty: it has 0 bytes')
    return [path]


def open_storage(path: Path) -> tuple[Storage, str]:
    """
    Open one of the `storage_files`; return its reader, and what's missing: 'index', 'end' or ''.

    Raises whatever rosbags and the storages below it raise.
    """
    reader: Storage
    missing = ''
    if path.suffix in ('.bag', '.active'):
        bag = unindexed_ros1(path)
        reader, missing = Ros1Reader(bag or path), 'index' if bag else ''
    elif path.suffix == '.mcap':
        file = unindexed_mcap(path)
        reader, missing = Ros2Reader(file or path), 'end' if file else ''
    else:
        # To read its write-ahead log, SQLite would have to write into the file.
        log = path.with_name(f'{path.name}-wal')
        reader = Ros2Reader(path)
        missing = 'end' if log.is_file() and log.stat().st_size else ''
    reader.open()
    if isinstance(reader, Ros2Reader) and not missing:
        for storage in getattr(reader.storage, 'storages', [reader.storage]):
            if isinstance(storage, McapReader):
                _index(storage)
    return reader, missing


def _index(storage: McapReader) -> None:
    """Open a storage anew, with an index of its messages, if it has none."""
    if not any(chunk.channel_count for chunk in storage.chunks):
        path = Path(str(storage.path))
        storage.close()
        storage.path = indexed_mcap(path)
        storage.open()


def _files_in(folder: Path) -> list[Path]:
    names = [path.name for path in folder.iterdir()]
    packed = sorted(name for name in names if name.endswith(('.mcap.zstd', '.db3.zstd'))
                    and name.removesuffix('.zstd') not in names)
    files = sorted((folder / name for name in names if name.endswith(('.mcap', '.db3'))),
                   key=by_number)
    if packed:
        # `ros2 bag reindex` finds no compressed files (ros2/rosbag2, issue 990).
        raise BagError(
            f'{folder} has compressed files, but no metadata.yaml: decompress '
            f"each, as with `zstd -d {packed[0]} -o {packed[0].removesuffix('.zstd')}`")
    if not files:
        raise BagError(f'{folder} is not a rosbag2 folder: it has no metadata.yaml, and no .mcap '
                       'or .db3 file either')
    if len({file.suffix for file in files}) > 1:
        raise BagError(f'{folder} has no metadata.yaml, but both .mcap and .db3 files: give a '
                       'single file, or move the files of each kind into a folder of their own')
    return files
