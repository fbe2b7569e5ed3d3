"""Reading a camera's calibration."""

import math
from typing import Any

from vtrack_ros.geometry.camera import Camera, MODELS


def camera_from_info(message: Any) -> Camera:
    """Read a CameraInfo; ValueError if it isn't calibrated, or its lens model is unknown."""
    matrix = [float(value) for value in message.k]
    if not all(map(math.isfinite, matrix)) or matrix[0] <= 0 or matrix[4] <= 0:
        raise ValueError(
            f'camera_info is not calibrated: fx and fy of k are {matrix[0]:g} and '
            f'{matrix[4]:g}, but must be positive')
    coefficients = tuple(float(value) for value in message.d)
    model = message.distortion_model
    if not any(coefficients):
        model, coefficients = 'plumb_bob', ()
    elif model not in MODELS:
        raise ValueError(f'camera_info has the unknown distortion model {model!r}; valid are '
                         + ', '.join(MODELS))
    elif len(coefficients) not in MODELS[model] or not all(map(math.isfinite, coefficients)):
        raise ValueError(
            f'camera_info has {len(coefficients)} distortion coefficients; {model} needs '
            + ' or '.join(map(str, MODELS[model])) + ' finite ones')
    roi = message.roi
    binning = (max(1, message.binning_x), max(1, message.binning_y))
    width, height = roi.width or message.width, roi.height or message.height
    return Camera(
        matrix[0], matrix[4], matrix[2], matrix[5], int(width) // binning[0],
        int(height) // binning[1], model, coefficients,
        (float(roi.x_offset), float(roi.y_offset)), (float(binning[0]), float(binning[1])))
