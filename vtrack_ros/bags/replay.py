"""Running a tracker over a bag: as fast as it goes, the same every time, without a node."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
import time

from vtrack_ros.bags.errors import BagError
from vtrack_ros.bags.reader import StampedFrame
from vtrack_ros.geometry import Box
from vtrack_ros.session.frame_flow import Arrival, FrameFlow
from vtrack_ros.session.motion_filter import Motion
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.trackers import Estimate

#: The state of a frame without a target, as the node calls it.
WAITING = 'waiting'


@dataclass(frozen=True)
class Step:
    """
    What came of one frame: the estimate after it, and the milliseconds that the tracker took.

    There is no estimate while there is no target, and no motion while it isn't measured; `started`
    says whether it began on this frame.
    """

    image: StampedFrame
    estimate: Estimate | None
    milliseconds: float
    started: bool = False
    motion: Motion | None = None


def replay(images: Iterable[StampedFrame], session: TrackingSession,
           truth: Mapping[int, Box | None], box: Box | None = None) -> Iterator[Step]:
    """
    Follow a target through images, as the node would that drops none but late ones.

    `session` has no target yet; `truth` is stamp in nanoseconds -> true box, None where the target
    is absent. `box` says where it is in the first image, and again where the stamps go backwards
    because a stream begins anew; by default the first true box says where it is, and when.
    BagError if neither does, or nothing of the target is in the image.
    """
    flow = FrameFlow()
    waiting = True
    for image in images:
        arrival = flow.arrived(image.stamp, 0)
        if arrival is Arrival.LATE:
            continue
        if arrival is not Arrival.NEXT:
            session.forget()
            waiting = True
            box = box if arrival is Arrival.BEGINNING else None
        first = (box or truth.get(image.stamp)) if waiting else None
        began = time.perf_counter()
        if first is not None:
            try:
                estimate: Estimate | None = session.start(image.frame, image.stamp, first)
            except ValueError as error:
                raise BagError(f'the tracker cannot start at stamp {image.stamp}: {error}'
                               ) from None
        else:
            estimate = session.update(image.frame, image.stamp)
        taken = (time.perf_counter() - began) * 1e3
        yield Step(image, estimate, taken, first is not None, session.motion())
        waiting = waiting and first is None
    if waiting and flow.received:
        raise BagError('nothing says where the target is: the bag has no true box for any image; '
                       'give --init X,Y,WIDTH,HEIGHT')
