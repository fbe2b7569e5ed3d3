"""What a session knows of a target that it may not see any more."""

from dataclasses import dataclass

from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box


@dataclass(frozen=True)
class LastMeasurement:
    """
    Where the target was last measured, on that frame, stamped in nanoseconds.

    The box is the one that it would have if it hadn't turned by the angle, [rad], since it was
    selected.
    """

    frame: Frame
    stamp: int
    box: Box
    angle: float = 0.0

    @property
    def bound(self) -> Box:
        """Return the box about the target as it has turned."""
        size = self.box.width, self.box.height
        return Box.around_ellipse(self.box.center, size, self.angle) if self.angle else self.box
