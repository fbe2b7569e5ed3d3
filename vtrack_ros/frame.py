"""What a frame is, and what other arrays and places are called."""

import numpy as np
from numpy.typing import NDArray

#: A frame: uint8, shape (H, W, 3) in BGR order or (H, W).
Frame = NDArray[np.uint8]
#: Numbers in double precision.
Array = NDArray[np.float64]
#: A place (x, y) or a size (width, height).
Point = tuple[float, float]
