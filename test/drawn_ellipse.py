"""A drawn ellipse of two colours, at any angle, on a noisy background."""

from __future__ import annotations

import math

import cv2
import numpy as np

from vtrack_ros.frame import Frame


def ellipse(center: tuple[float, float], axes: tuple[float, float], angle: float = 0.0,
            seed: int = 0, colour: bool = True) -> Frame:
    """Draw an ellipse of semi-axes in pixels, turned by an angle in rad, on 320 x 240 pixels."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:240, :320] + 0.5
    x, y = x - center[0], y - center[1]
    along = (x * math.cos(angle) + y * math.sin(angle)) / axes[0]
    across = (y * math.cos(angle) - x * math.sin(angle)) / axes[1]
    frame = np.full((240, 320, 3), (90, 100, 80), np.float64)
    frame[along**2 + across**2 <= 1] = (40, 60, 200)
    frame[(along - 0.2)**2 + (across + 0.1)**2 <= 0.2] = (220, 200, 40)
    pixels = np.clip(frame + rng.normal(0, 2, frame.shape), 0, 255).astype(np.uint8)
    return pixels if colour else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
