"""`python -m vtrack_ros.demo.camera_source SOURCE`: a webcam's or a video's images on a topic."""

from collections.abc import Iterator
from pathlib import Path
import signal
import sys
import time

import cv2

from vtrack_ros.dds import end_process, leave
from vtrack_ros.file_names import is_utf8
from vtrack_ros.frame import Frame
from vtrack_ros.signals import ending_signals

#: The frame rate assumed for a video that doesn't state its own, in Hz.
_USUAL_RATE = 30.0


class NoImagesError(RuntimeError):
    """A camera that can't be opened, or a file that is no video; the message says which."""


def opened(source: str) -> cv2.VideoCapture:
    """
    Open a camera by its number, or a video file, and grab its first image.

    NoImagesError if no image comes.
    """
    if source.isdecimal():
        # Checked first, since OpenCV would print many lines of errors.
        if sys.platform == 'linux' and not Path(f'/dev/video{source}').exists():
            raise NoImagesError(f'there is no camera {source} (/dev/video{source})')
        capture = cv2.VideoCapture(int(source))
        fault = f'camera {source} sends no image; is another program using it?'
    elif not Path(source).is_file():
        raise NoImagesError(f'{source} does not exist')
    elif not is_utf8(source):
        raise NoImagesError(f'{source} is not UTF-8, which OpenCV cannot open: rename it')
    else:
        capture, fault = cv2.VideoCapture(source), f'{source} is not a video that OpenCV can read'
    if not (capture.isOpened() and capture.grab()):
        capture.release()
        raise NoImagesError(fault)
    return capture


def images(source: str) -> Iterator[Frame]:
    """Yield a camera's images as they come, or a video's at its frame rate, in an endless loop."""
    while True:
        capture = opened(source)
        rate = capture.get(cv2.CAP_PROP_FPS) or _USUAL_RATE
        due = time.monotonic()
        # Not rewound: OpenCV doesn't go back to the only image of a file.
        found, image = capture.retrieve()
        if not found:
            raise NoImagesError(f'the first image of {source} cannot be decoded')
        while found:
            yield image
            due += 1 / rate
            if not source.isdecimal():
                time.sleep(max(0.0, due - time.monotonic()))
            found, image = capture.read()
        capture.release()


def main(source: str) -> int:
    """Publish on `image`; return 0 when a signal ends it, 2 when no image comes any more."""
    import rclpy
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import Image

    from vtrack_ros.messages.images import fill_image
    ended: list[int] = []
    for number in ending_signals():
        signal.signal(number, lambda caught, _: ended.append(caught))
    rclpy.init(signal_handler_options=rclpy.SignalHandlerOptions.NO)
    node = rclpy.create_node('camera')
    publisher = node.create_publisher(Image, 'image', qos_profile_sensor_data)
    message = Image()
    message.header.frame_id = 'camera'
    code = 0
    try:
        for frame in images(source):
            fill_image(message, frame)
            message.header.stamp = node.get_clock().now().to_msg()
            publisher.publish(message)
            if ended:
                break
    except NoImagesError as error:
        print(f'camera: {error}', file=sys.stderr)
        code = 2
    leave(node)
    rclpy.try_shutdown()
    return end_process(code)


if __name__ == '__main__':
    try:
        sys.exit(main(sys.argv[1]))
    except KeyboardInterrupt:
        sys.exit(0)
