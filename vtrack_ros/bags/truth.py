"""Ground truth beside a bag: a CSV with one row per frame."""

from collections.abc import Mapping
import csv
import math
from pathlib import Path

from vtrack_ros.bags.errors import BagError
from vtrack_ros.geometry import Box

#: The topic that carries the truth in a bag.
TRUTH_TOPIC = '/truth'
#: The file that carries it beside the bag's storage, in the bag's folder.
TRUTH_FILE = 'truth.csv'

_COLUMNS = ['stamp_ns', 'x', 'y', 'width', 'height']


def true_box(x: float, y: float, width: float, height: float) -> Box | None:
    """Return a true box; None (the target is absent) if it isn't finite or has no area."""
    finite = all(map(math.isfinite, (x, y, width, height)))
    return Box(x, y, width, height) if finite and width > 0 and height > 0 else None


def write_truth(path: Path, truth: Mapping[int, Box | None]) -> None:
    """Write ``stamp_ns,x,y,width,height`` rows; NaN where the target is absent."""
    with path.open('w', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(_COLUMNS)
        for stamp, box in truth.items():
            values = [math.nan] * 4 if box is None else box.as_array().tolist()
            writer.writerow([stamp, *(repr(value) for value in values)])


def read_truth(path: Path) -> dict[int, Box | None]:
    """
    Read what `write_truth` wrote; BagError, with the line, if it isn't such a table.

    The text may begin with a byte order mark, as editors of other systems write it.
    """
    truth: dict[int, Box | None] = {}
    try:
        rows = list(csv.reader(path.read_text(encoding='utf-8-sig').splitlines()))
    except (UnicodeDecodeError, csv.Error) as error:
        raise BagError(f'{path}: {error}') from None
    if rows[:1] != [_COLUMNS]:
        raise BagError(f'{path}: the first line must be {",".join(_COLUMNS)}')
    for number, row in enumerate(rows[1:], start=2):
        try:
            stamp, (x, y, width, height) = int(row[0]), map(float, row[1:])
        except (IndexError, ValueError):
            raise BagError(f'{path}, line {number}: expected {",".join(_COLUMNS)} as numbers, '
                           f'not {",".join(row)!r}') from None
        truth[stamp] = true_box(x, y, width, height)
    return truth
