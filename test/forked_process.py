"""
Processes that start with ROS and the package already loaded, as forks of one server process.

Loading, with what is loaded once ROS is up and when the first frames come, takes a second of
processor time in each of some sixty nodes; from `main` on, what they do is the same. Run as a
script, with a socket's file descriptor, this module is the server that is forked.
"""

from __future__ import annotations

import atexit
from collections.abc import Sequence
import ctypes
from functools import cache
import gc
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
from typing import TextIO

LOADED = ('vtrack_ros.ros.main', 'vtrack_ros.ros.tracker_node', 'vtrack_ros.ros.lifecycle')
#: Messages whose type support rclpy loads with the first publisher or subscription of each.
MESSAGES = {'diagnostic_msgs': 'DiagnosticArray', 'geometry_msgs': 'PoseStamped',
            'rcl_interfaces': 'ParameterEvent', 'sensor_msgs': 'Image', 'std_msgs': 'Header',
            'type_description_interfaces': 'TypeDescription', 'vision_msgs': 'Detection2DArray'}


class ForkedProcess:
    """A process that runs a function without arguments and ends with its exit code."""

    def __init__(self, module: str, function: str, arguments: Sequence[str],
                 environment: dict[str, str]) -> None:
        output, status = os.pipe(), os.pipe()
        request = json.dumps([module, function, list(arguments), environment])
        socket.send_fds(_server(), [request.encode()], [output[1], status[1]])
        os.close(output[1])
        os.close(status[1])
        self.stdout: TextIO = os.fdopen(output[0])
        self._status = os.fdopen(status[0])
        self.pid = int(self._status.readline())
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit code, or None while it runs."""
        return self._ended_within(0)

    def wait(self, timeout: float) -> int:
        """Return the exit code, once it has ended."""
        code = self._ended_within(timeout)
        if code is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal."""
        os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill it by SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def _ended_within(self, seconds: float) -> int | None:
        if self.returncode is None and select.select([self._status], [], [], seconds)[0]:
            self.returncode = int(self._status.readline())
            self._status.close()
        return self.returncode


@cache
def _server() -> socket.socket:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    process = subprocess.Popen([sys.executable, __file__, str(theirs.fileno())],
                               pass_fds=[theirs.fileno()])
    theirs.close()

    def stop() -> None:
        ours.close()
        process.wait()
    atexit.register(stop)
    return ours


def _serve(requests: socket.socket) -> None:
    end_with_parent()
    for module in LOADED:
        importlib.import_module(module)
    _warm_up()
    while True:
        text, (*files,), _, _ = socket.recv_fds(requests, 1 << 20, 2)
        if not text:
            break
        if os.fork() == 0:
            requests.close()
            end_with_parent()
            _keep(files[1], files[0], *json.loads(text))
        for file in files:
            os.close(file)
    # Wait for all children, so that their processor time is counted.
    while True:
        try:
            os.wait()
        except ChildProcessError:
            return


def _warm_up() -> None:
    """Load what a node loads later, without starting threads: a fork wouldn't have them."""
    import cv2
    from rclpy.type_support import check_is_valid_msg_type
    from vtrack_ros.session.session import TrackingSession
    cv2.setNumThreads(1)
    TrackingSession().warm_up()
    for package, message in MESSAGES.items():
        check_is_valid_msg_type(getattr(importlib.import_module(f'{package}.msg'), message))
    gc.collect()
    gc.freeze()


def _keep(status: int, output: int, module: str, function: str, arguments: list[str],
          environment: dict[str, str]) -> None:
    """Run the function in a process of its own; write its PID, and then its exit code."""
    pid = os.fork()
    if pid == 0:
        end_with_parent()
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.close(output)
        os.close(status)
        # the server's own may know its output as a file, in which one can seek
        sys.stdout = open(1, 'w', closefd=False)
        os.environ.clear()
        os.environ.update(environment)
        sys.argv = ['-c', *arguments]
        sys.exit(getattr(importlib.import_module(module), function)())
    os.close(output)
    os.write(status, f'{pid}\n'.encode())
    _, how = os.waitpid(pid, 0)
    os.write(status, f'{os.waitstatus_to_exitcode(how)}\n'.encode())
    os._exit(0)


def end_with_parent() -> None:
    """Have the kernel end this process with its parent (PR_SET_PDEATHSIG is 1)."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)


if __name__ == '__main__':
    _serve(socket.socket(fileno=int(sys.argv[1])))
