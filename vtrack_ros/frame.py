"""Types of frames, arrays and points."""

import numpy as np
from numpy.typing import NDArray

#: A frame: uint8, shape (H, W, 3) in BGR order or (H, W).
Frame = NDArray[np.uint8]
#: An array of double precision.
Array = NDArray[np.float64]
#: An array of single precision.
Array32 = NDArray[np.float32]
#: A position (x, y) or a size (width, height).
Point = tuple[float, float]
