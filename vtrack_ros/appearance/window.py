"""Resampling a window of a frame to a fixed number of pixels, at a fixed cost."""

from __future__ import annotations

import cv2
import numpy as np

from vtrack_ros.frame import Frame


def sample_window(frame: Frame, center: tuple[float, float], size: tuple[float, float],
                  shape: tuple[int, int]) -> Frame:
    """
    Resample a window to a fixed shape; what's outside the frame repeats its border.

    Where several pixels fall on one sample, a regular subset of them is used: the cost depends on
    the shape alone, and neither on the window's size nor on the frame's. A window of whole pixels
    inside the frame is the quickest.

    Parameters
    ----------
    frame : ndarray of uint8, shape (H, W, 3) or (H, W)
        The image.
    center, size : tuple of float, [px]
        The window's centre (x, y) and size (width, height).
    shape : tuple of int
        (rows, columns) of the result.

    Returns
    -------
    ndarray of uint8, shape (rows, columns, 3) or (rows, columns)

    """
    rows, columns = shape
    step_x, step_y = size[0] / columns, size[1] / rows
    left, top = center[0] - size[0] / 2, center[1] - size[1] / 2
    height, width = frame.shape[:2]
    x, y, right, bottom = int(left), int(top), int(left + size[0]), int(top + size[1])
    whole = (x, y, right, bottom) == (left, top, left + size[0], top + size[1])
    if whole and 0 <= x < right <= width and 0 <= y < bottom <= height:
        window: Frame = cv2.resize(
            frame[y:bottom, x:right], (columns, rows), interpolation=cv2.INTER_LINEAR)
        return window
    offset_x = offset_y = 0
    stride = max(1, int(min(step_x, step_y)))
    if stride > 1:
        offset_x = min(max(int(left) - stride, 0), width - 1)
        offset_y = min(max(int(top) - stride, 0), height - 1)
        right = min(max(int(left + size[0]) + 2 * stride, offset_x + 1), width)
        bottom = min(max(int(top + size[1]) + 2 * stride, offset_y + 1), height)
        frame = np.ascontiguousarray(frame[offset_y:bottom:stride, offset_x:right:stride])
    # OpenCV counts from the centre of a pixel, boxes from its outer corner
    matrix = np.array([
        [step_x / stride, 0.0, (left + step_x / 2 - 0.5 - offset_x) / stride],
        [0.0, step_y / stride, (top + step_y / 2 - 0.5 - offset_y) / stride]])
    window = cv2.warpAffine(
        frame, matrix, (columns, rows), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE)
    return window
