"""What both presets of ABMSPF share: its settings, and the fusion of mean shift and particles."""

from __future__ import annotations

from dataclasses import dataclass
import math

Point = tuple[float, float]


@dataclass(frozen=True)
class Settings:
    """
    The parameters of ABMSPF.

    Parameters
    ----------
    particles : int
        0 for mean shift alone.
    accepted : float
        Likeness `th` from which mean shift is trusted.
    rejected : float
        Likeness `r` below which the target counts as hidden.
    region : float
        Reach of the particles, in semi-axes of the target.
    inertia : float
        Share of the last step that the motion model expects again.
    growth : float
        Largest relative change of an axis in one frame.
    levels : int
        Levels of a colour channel.
    background : bool
        Whether colours count less that the first surroundings share.
    learning : float
        How fast the colours follow a target that is seen well.

    """

    particles: int
    accepted: float
    rejected: float
    region: float
    inertia: float
    growth: float
    levels: int
    background: bool
    learning: float


def fused(zeta: float, climbed: Point, best: Point, near: float, far: float,
          settings: Settings) -> Point | None:
    """
    Fuse the places that mean shift and the particles found [Yin2013, eqs 13-15].

    Parameters
    ----------
    zeta : float
        The likeness at `climbed`.
    climbed, best : tuple of float, [px]
        y_ms and y_pf.
    near, far : float, [px]
        The distances sigma and sigma a, within which the two agree and are compatible.
    settings : Settings
        Whose thresholds count.

    Returns
    -------
    tuple of float, [px], or None
        None where the two contradict each other.

    """
    if zeta <= settings.rejected:
        return best
    distance = math.dist(climbed, best)
    if distance > far:
        return None
    if zeta < settings.accepted:
        return best
    if distance >= near:
        return climbed
    return (zeta * climbed[0] + (1 - zeta) * best[0], zeta * climbed[1] + (1 - zeta) * best[1])
