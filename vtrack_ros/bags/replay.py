"""Running a tracker over a bag: as fast as possible, reproducibly, and without a node."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
import time

from vtrack_ros.bags.errors import BagError
from vtrack_ros.bags.reader import StampedFrame
from vtrack_ros.geometry import Box
from vtrack_ros.session.frame_flow import Arrival, FrameFlow
from vtrack_ros.session.motion_filter import Motion
from vtrack_ros.session.selection import Selection
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.trackers import Estimate

#: The node's name for the state without a target.
WAITING = 'waiting'


@dataclass(frozen=True)
class Step:
    """
    The result of one frame: the estimate after it, and the tracker's computing time [ms].

    `estimate` is None while there is no target, `motion` is None while it isn't known;
    `started` says whether tracking started on this frame.
    """

    image: StampedFrame
    estimate: Estimate | None
    milliseconds: float
    started: bool = False
    motion: Motion | None = None


def replay(images: Iterable[StampedFrame], session: TrackingSession,
           truth: Mapping[int, Box | None], box: Box | None = None,
           late: list[int] | None = None) -> Iterator[Step]:
    """
    Track a target through images, as a node that drops no frames but late ones.

    `session` has no target yet; `truth` holds the true boxes by stamp in nanoseconds, None where
    the target is absent. The tracker starts on `box` in the first image, and again where stamps go
    backwards because a stream begins again; by default it starts on the first true box.
    Where they go back because a clock was set back, it needs another true box, as a target must be
    selected anew then. BagError if it never starts, or the tracker can't start on the box;
    RuntimeError if it fails otherwise, with its own TypeError or ValueError as the cause.

    An image is late, as in the node, if a later one came before it, or if its stamp is a minute
    further on than its recording. It's left out, and its stamp is appended to `late`.
    """
    flow = FrameFlow()
    waiting, started = True, False
    now = 0
    before: int | None = None
    for image in images:
        # the recorder's clock may be set back, but the flow's never is
        now += 0 if before is None else max(0, image.received - before)
        before = image.received
        arrival = flow.arrived(image.stamp, now)
        if arrival is Arrival.LATE:
            if late is not None:
                late.append(image.stamp)
            continue
        if arrival is not Arrival.NEXT:
            session.forget()
            waiting = True
            box = box if arrival is Arrival.BEGINNING else None
        first = (box or truth.get(image.stamp)) if waiting else None
        began = time.perf_counter()
        try:
            if first is None:
                estimate = session.update(image.frame, image.stamp)
            else:
                if box is not None:
                    # as the node checks it; a true box may be of any size
                    first = Selection(box, '--init').box_on(image.frame)
                estimate = session.start(image.frame, image.stamp, first)
        except (TypeError, ValueError) as error:
            if first is not None and isinstance(error, ValueError):
                raise BagError(f'the tracker cannot start at stamp {image.stamp}: {error}'
                               ) from None
            # nothing that was given is wrong, but the tracker, such as another package's
            raise RuntimeError(
                f'tracker {session.tracker} failed at stamp {image.stamp}: {error}') from error
        taken = (time.perf_counter() - began) * 1e3
        yield Step(image, estimate, taken, first is not None, session.motion())
        waiting, started = waiting and first is None, started or first is not None
    if flow.received and not started:
        raise BagError('none of the images has a ground-truth box: give the target with '
                       '--init X,Y,WIDTH,HEIGHT')
