"""A drawn card that turns and grows over a duller background."""

import cv2
from drawn_video import noise_part, SIZE
import numpy as np

from vtrack_ros.geometry import affine, Box


def card_texture(width, height, seed, cell):
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 256, (height // cell + 2, width // cell + 2, 3), dtype=np.uint8)
    picture = cv2.resize(coarse, None, fx=cell, fy=cell, interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(picture[:height, :width])


class DrawnCard:
    """A textured 60 x 44 card over a duller background."""

    size = (60.0, 44.0)

    def __init__(self, grey=False):
        self.background = 90 + card_texture(*SIZE, 1, 16) // 6
        self.card = card_texture(60, 44, 2, 7)
        self.grey = grey

    def frame(self, center, turn=0.0, scale=1.0, seed=0):
        matrix = np.zeros((2, 3))
        matrix[:, :2] = scale * affine.rotation(np.asarray(turn))
        matrix[:, 2] = np.array(center) - 0.5 - matrix[:, :2] @ (29.5, 21.5)
        mask = cv2.warpAffine(np.full((44, 60), 255, np.uint8), matrix, SIZE)[:, :, None]
        mask = mask / np.float32(255)
        drawn = self.background * (1 - mask) + mask * cv2.warpAffine(self.card, matrix, SIZE)
        drawn += 3 * noise_part(np.random.default_rng(seed))
        result = np.clip(drawn, 0, 255).astype(np.uint8)
        return cv2.cvtColor(result, cv2.COLOR_BGR2GRAY) if self.grey else result

    def box(self, center):
        return Box.from_center(*center, *self.size)
