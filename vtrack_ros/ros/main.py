"""The executable `tracker`: tracks one target in sensor_msgs/Image."""

from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
import os
import signal
import sys
from types import FrameType

from vtrack_ros.dds import end_process, leave, receiving_profile
from vtrack_ros.signals import ending_signals

_SIGNALS = ending_signals()

HELP = """\
usage: tracker [--ros-args [-r FROM:=TO]... [-p NAME:=VALUE]... [--params-file FILE]]

Tracks a target in the images of a topic and publishes its position. Select the target with
-p init_box:="[x, y, width, height]", in pixels of the first image, or while the node is running on
~/init_roi, ~/init or ~/init_point.

  tracker --ros-args -r image:=/camera/image_raw -p init_box:="[300, 200, 60, 80]"

See docs/node.md for the topics and docs/parameters.md for the parameters."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the plain node until a signal ends it; return the exit code."""
    return _run('tracker_node', 'TrackerNode', arguments)


def lifecycle_main(arguments: Sequence[str] | None = None) -> int:
    """Run the managed node until a signal ends it; return the exit code."""
    return _run('lifecycle', 'TrackerLifecycleNode', arguments)


def _run(module: str, node: str, arguments: Sequence[str] | None) -> int:
    """
    Initialise ROS, create a node, and spin it in one thread until a signal ends it.

    Returns the exit code: 0 after a signal or --help, 2 if an argument or a parameter is wrong at
    the start, or a Python package is missing.
    """
    # The matrices of a target are too small for multithreaded products to pay; on a robot the
    # threads only take CPU time from other processes. NumPy, loaded later, reads the variable.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    os.environ.update(receiving_profile(os.environ))
    # ROS takes a while to load; a signal in that time must end the process as cleanly as later.
    # The wheels of PyPI exec Python anew while loading: handlers don't survive that, but blocked
    # signals stay blocked, and are delivered once they're unblocked.
    for number in _SIGNALS:
        signal.signal(number, signal.default_int_handler)
    signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    try:
        return _spin(module, node, arguments)
    except KeyboardInterrupt:
        return 0
    except ModuleNotFoundError as error:
        print(f'tracker: the Python package {error.name} is missing: source a ROS 2 installation '
              '("source /opt/ros/jazzy/setup.bash"), or install vtrack_ros[ros] with pip',
              file=sys.stderr)
        return 2


def _spin(module: str, kind: str, arguments: Sequence[str] | None) -> int:
    import gc

    import rclpy
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    import cv2
    from rclpy.clock import Clock, ClockType
    from rclpy.exceptions import ParameterException
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.impl.implementation_singleton import rclpy_implementation as rcl
    import rclpy.utilities

    words = list(sys.argv if arguments is None else arguments)
    cv2.setNumThreads(1)
    # Blocked, for an executor whose construction a signal interrupts raises errors when destroyed.
    signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    # From here on rclpy handles the signals, all but SIGHUP (which becomes SIGTERM): an exception
    # raised by a handler within ROS's own code would come out as another one, or be lost.
    for number in _SIGNALS:
        signal.signal(number, _leave_to_ros)
    try:
        rclpy.init(args=words)
        executor = SingleThreadedExecutor()
    except (RuntimeError, ValueError) as error:
        print(f'tracker: {_explained(str(error))}', file=sys.stderr)
        return 2
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    node = None
    try:
        left = rclpy.utilities.remove_ros_args(words)[1:]
        if left:
            wanted = left[0] in ('-h', '--help')
            print(HELP if wanted else f'tracker: unknown argument {left[0]!r}; see --help',
                  file=sys.stdout if wanted else sys.stderr)
            return 0 if wanted else 2
        try:
            node = getattr(import_module(f'vtrack_ros.ros.{module}'), kind)()
        except (ParameterException, rcl.RCLError, TypeError, ValueError) as error:
            if not rclpy.ok():
                raise
            print('tracker:', *str(error).split(), file=sys.stderr)
            return 2
        # Objects that exist now live on, so garbage collection may skip them: a full collection
        # stops the node for several frames of a fast camera.
        gc.collect()
        gc.freeze()
        # A signal that comes just as the executor goes to sleep may fail to wake it: this timer
        # lets it see the shutdown within a second, instead of never.
        node.create_timer(1.0, lambda: None, clock=Clock(clock_type=ClockType.STEADY_TIME))
        executor.add_node(node)
        while rclpy.ok():
            try:
                executor.spin()
            except Exception as error:
                # A request that rclpy can't deserialise raises an exception here; the node has
                # to survive it.
                if not rclpy.ok():
                    raise
                node.get_logger().error(f'{type(error).__name__}: {error}',
                                        throttle_duration_sec=2.0)
    except Exception:
        # After a shutdown an exception only ends the spinning, and is no error.
        if rclpy.ok():
            raise
    finally:
        # A second signal must not turn a clean end into a traceback.
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        if node is not None:
            leave(node)
        # the signal handler's thread may end the context between rclpy's check and its call
        with suppress(rcl.RCLError):
            rclpy.try_shutdown()
    return end_process(0)


def _leave_to_ros(number: int, _: FrameType | None) -> None:
    if number == signal.SIGHUP:
        signal.raise_signal(signal.SIGTERM)


def _explained(text: str) -> str:
    """Return rcl's error message about arguments, with what is valid added."""
    if text.startswith('['):
        return (f'unknown ROS arguments {text}; valid are -r FROM:=TO, -p NAME:=VALUE, '
                '--params-file FILE and --log-level LEVEL, and --help after a --')
    if 'Sequence should be of same type' in text:
        text += ('; write all numbers of a list with a decimal point, as in '
                 'init_box: [300.0, 200.0, 60.0, 80.0]')
    return text


if __name__ == '__main__':
    sys.exit(main())
