"""`vtrack play` in a process of its own, and a node that hears what it publishes."""

import os
import subprocess
import sys
import time

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from shared_segments import kill

from vtrack_ros.dds import leave

PATIENCE = 30.0


class Listener:
    """A node that stores the messages that it receives."""

    def __init__(self):
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node('listener', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def hear(self, kind, topic, reliability=ReliabilityPolicy.RELIABLE, qos=None):
        """Subscribe; return the list of messages with the time of their arrival."""
        heard = []
        qos = qos or QoSProfile(depth=1000, reliability=reliability)
        self.node.create_subscription(
            kind, topic, lambda message: heard.append((time.monotonic(), message)), qos)
        return heard

    def spin_until(self, condition, what):
        """Spin until a condition holds."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, what
            self.executor.spin_once(timeout_sec=0.02)

    def __enter__(self):
        """Return the listener."""
        return self

    def __exit__(self, *_):
        """Take the node down."""
        self.executor.shutdown()
        leave(self.node)
        rclpy.try_shutdown(context=self.context)


def play(*arguments, command=('-m', 'vtrack_ros.cli.command_line')):
    """Start a player."""
    return subprocess.Popen(
        [sys.executable, *command, 'play', *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ))


def finish(player, number=None):
    """Return exit code, output and errors of a player; send it a signal first, if one is given."""
    if number is not None:
        player.send_signal(number)
    try:
        out, err = player.communicate(timeout=PATIENCE)
    finally:
        kill(player)
    assert 'Traceback' not in err, err
    return player.returncode, out, err
