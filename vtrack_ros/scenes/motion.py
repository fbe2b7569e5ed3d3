"""Motions: keyframes joined smoothly, and the small unrest of living things and hands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math

import numpy as np
from scipy.interpolate import PchipInterpolator

#: A value that changes with time in frames.
Motion = Callable[[float], float]


def keyframes(*points: tuple[float, float]) -> Motion:
    """
    Return a smooth motion through (time, value) points; it doesn't overshoot.

    Before the first and after the last point it rests.

    """
    times, values = zip(*points)
    curve = PchipInterpolator(times, values)

    def motion(time: float) -> float:
        return float(curve(min(max(time, times[0]), times[-1])))

    return motion


def stepwise(*points: tuple[float, float]) -> Motion:
    """Return a motion that goes from one value to the next between their times, evenly."""
    times, values = zip(*points)
    return lambda time: float(np.interp(time, times, values))


def unrest(rng: np.random.Generator, amplitude: float, period: float) -> Motion:
    """Return a motion about 0 that never quite repeats: a sum of sines of about a period."""
    periods = period * rng.uniform(0.35, 1.6, 5)
    phases = rng.uniform(0, 2 * math.pi, 5)
    parts: Sequence[tuple[float, float, float]] = [
        (amplitude * 0.63 * math.sqrt(size / period), 2 * math.pi / size, phase)
        for size, phase in zip(periods, phases)]

    def motion(time: float) -> float:
        return sum(a * math.sin(w * time + p) for a, w, p in parts)

    return motion
