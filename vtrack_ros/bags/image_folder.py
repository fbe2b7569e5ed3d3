"""Folders of images with a ground truth, as the tracking benchmarks publish them."""

from pathlib import Path
import re

import cv2
import numpy as np

from vtrack_ros.bags.errors import SequenceError
from vtrack_ros.bags.truth import true_box
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box

#: The name of a folder's ground truth, without its suffix.
GROUND_TRUTH = 'groundtruth_rect'

_IMAGE_SUFFIXES = frozenset({'.jpg', '.jpeg', '.png', '.bmp', '.tif', '.tiff', '.pgm', '.ppm'})


def image_files(folder: Path) -> tuple[Path, ...]:
    """
    Return the images in img/ or the folder itself, 2.png before 10.png; SequenceError if none.

    Hidden files are left out, such as the `._2.png` that a Mac writes beside 2.png.
    """
    for place in (folder / 'img', folder):
        if place.is_dir():
            files = sorted((path for path in place.iterdir()
                            if path.suffix.lower() in _IMAGE_SUFFIXES
                            and not path.name.startswith('.')), key=by_number)
            if files:
                return tuple(files)
    raise SequenceError(f'{folder}: no images, neither in img/ nor in the folder itself')


def read_image(path: Path) -> Frame:
    """
    Return an image file as a frame of shape (H, W, 3) in BGR order, grey ones too.

    It's rotated upright where the file has an EXIF orientation. SequenceError if it can't be read
    or decoded.
    """
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise SequenceError(f'{path}: {error.strerror or error}') from None
    image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if image is None:
        raise SequenceError(f'{path}: not an image that can be decoded')
    return np.asarray(image, dtype=np.uint8)


def ground_truth_files(folder: Path) -> list[Path]:
    """Return the ground-truth files of a folder, the shortest name (the plain one) first."""
    return sorted(folder.glob(f'{GROUND_TRUTH}*.txt'), key=lambda path: (len(path.name), path))


def read_ground_truth(path: Path) -> list[Box | None]:
    """
    Return the boxes of a ground truth, None where the target is absent.

    Rows are x, y, width, height in pixels, 0-based, separated by commas, semicolons or blanks;
    the first may follow a byte order mark. SequenceError if one isn't four numbers, or there is
    none.
    """
    boxes = []
    try:
        text = path.read_text(encoding='utf-8-sig')
    except (OSError, UnicodeDecodeError) as error:
        raise SequenceError(f'{path}: {error}') from None
    for number, line in enumerate(text.splitlines(), 1):
        words = line.replace(',', ' ').replace(';', ' ').split()
        if not words:
            continue
        try:
            x, y, width, height = map(float, words)
        except ValueError:
            raise SequenceError(f'{path}:{number}: expected four numbers x,y,width,height, '
                                f'not {line.strip()!r}') from None
        boxes.append(true_box(x, y, width, height))
    if not boxes:
        raise SequenceError(f'{path}: no boxes')
    return boxes


def by_number(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Return a sort key of paths that puts 2.png before 10.png."""
    parts = [(int(part), '') if part.isdecimal() else (-1, part)
             for part in re.split(r'(\d+)', path.name)]
    return parts, path.name
