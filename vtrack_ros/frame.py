"""What a frame is, and what other arrays and places are called."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: A frame: uint8, shape (H, W, 3) in BGR order or (H, W).
Frame = NDArray[np.uint8]
#: Numbers in double precision.
Array = NDArray[np.float64]
#: A place (x, y) or a size (width, height).
Point = tuple[float, float]


def checked_frame(frame: Any) -> Frame:
    """
    Return a contiguous frame.

    Raises
    ------
    TypeError
        If it isn't an ndarray of uint8.
    ValueError
        If its shape is neither (H, W, 3) nor (H, W), or it's empty.

    """
    if not isinstance(frame, np.ndarray):
        raise TypeError(f'frame must be a numpy array of uint8, not {type(frame).__name__}')
    if frame.dtype != np.uint8:
        raise TypeError(f'frame must be of uint8, not {frame.dtype}')
    if frame.ndim not in (2, 3) or (frame.ndim == 3 and frame.shape[2] != 3):
        raise ValueError(
            f'frame must have shape (H, W, 3) in BGR order or (H, W), not {frame.shape}')
    if 0 in frame.shape:
        raise ValueError(f'frame must have at least one pixel, but its shape is {frame.shape}')
    return np.ascontiguousarray(frame)
