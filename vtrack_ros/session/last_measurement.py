"""The last measurement of a target, which may be out of sight since then."""

from dataclasses import dataclass

from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box


@dataclass(frozen=True)
class LastMeasurement:
    """
    Where the target was last measured, in the frame with that stamp in nanoseconds.

    The box is upright: it doesn't include the target's rotation by the angle, [rad], since it was
    selected.
    """

    frame: Frame
    stamp: int
    box: Box
    angle: float = 0.0

    @property
    def bound(self) -> Box:
        """Return the axis-aligned bound of the rotated target."""
        size = self.box.width, self.box.height
        return Box.around_ellipse(self.box.center, size, self.angle) if self.angle else self.box
