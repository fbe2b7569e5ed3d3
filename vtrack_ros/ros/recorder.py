"""
Records what a tracking node publishes, until it's told to end; a process of the demo.

Writes a line to standard output when it's matched with the node (`ready`), and one for every frame
that was answered (`frame`); the record itself goes into a JSON file at the end.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
from pathlib import Path
import sys
import time
from typing import Any

#: How many particles of a frame are kept, for the pictures.
KEPT_PARTICLES = 150


class Record:
    """
    What was heard, by the stamp of the image in nanoseconds.

    Attributes
    ----------
    frames : dict of int to dict
        Stamp -> ``received_ns``, and where they were heard ``box``, ``particles``, ``state``,
        ``ms_per_frame`` and ``latency_ms``.

    """

    def __init__(self) -> None:
        self.frames: dict[int, dict[str, Any]] = {}

    def on_detections(self, message: Any) -> None:
        """Take the answer to a frame."""
        now = time.time_ns()
        row = self._row(message.header.stamp)
        row['received_ns'] = now
        for detection in message.detections[:1]:
            bounds = detection.bbox
            row['box'] = [bounds.center.position.x - bounds.size_x / 2,
                          bounds.center.position.y - bounds.size_y / 2,
                          bounds.size_x, bounds.size_y]
        print('frame', flush=True)

    def on_particles(self, message: Any) -> None:
        """Take the particles of a frame."""
        self._row(message.header.stamp)['particles'] = [
            [pose.position.x, pose.position.y] for pose in message.poses[:KEPT_PARTICLES]]

    def on_state(self, message: Any) -> None:
        """Take the state after a frame."""
        values = {row.key: row.value for row in message.values}
        if 'stamp' not in values:
            return
        seconds, nanoseconds = values['stamp'].split('.')
        row = self.frames.setdefault(int(seconds) * 10**9 + int(nanoseconds), {})
        row['state'] = message.message
        row['ms_per_frame'] = float(values['ms_per_frame'])
        row['sent_ns'] = int(values['image_sent'])

    def as_json(self) -> dict[str, Any]:
        """Return the record, with the latency from publishing an image to hearing its result."""
        for row in self.frames.values():
            if row.get('sent_ns') and 'received_ns' in row:
                row['latency_ms'] = (row['received_ns'] - row['sent_ns']) / 1e6
        return {'frames': {str(stamp): row for stamp, row in sorted(self.frames.items())}}

    def _row(self, stamp: Any) -> dict[str, Any]:
        return self.frames.setdefault(stamp.sec * 10**9 + stamp.nanosec, {})


def main(arguments: Sequence[str] | None = None) -> int:
    """Record until standard input closes; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--out', type=Path, required=True, help='the JSON file')
    options = parser.parse_args(arguments)

    from diagnostic_msgs.msg import DiagnosticStatus
    from geometry_msgs.msg import PoseArray
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from vision_msgs.msg import Detection2DArray

    record = Record()
    rclpy.init(args=[])
    try:
        node = Node('recorder')
        qos = QoSProfile(depth=1000)
        subscriptions = [
            node.create_subscription(
                Detection2DArray, 'detections', record.on_detections, qos),
            node.create_subscription(
                DiagnosticStatus, 'tracker/state', record.on_state, qos),
            node.create_subscription(
                PoseArray, 'tracker/particles', record.on_particles, qos)]
        told = False
        ended = _closing(sys.stdin)
        while not ended.is_set():
            rclpy.spin_once(node, timeout_sec=0.05)
            if not told and all(subscription.get_publisher_count()
                                for subscription in subscriptions):
                told = True
                print('ready', flush=True)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        options.out.write_text(json.dumps(record.as_json()))
        rclpy.try_shutdown()
    return 0


def _closing(stream: Any) -> Any:
    """Return an event that is set when a stream is closed at its other end."""
    import threading
    event = threading.Event()

    def wait() -> None:
        stream.read()
        event.set()
    threading.Thread(target=wait, daemon=True).start()
    return event


if __name__ == '__main__':
    sys.exit(main())
