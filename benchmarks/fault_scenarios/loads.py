"""Faults of load: unusual, missing and too many images, and clients of the parameters."""

from __future__ import annotations

from array import array
import threading
import time
from typing import Any

from fault_scenarios.sender import PATIENCE, PERIOD, RATE, Sender, tracking_node
from node_bench import rss_mb
import numpy as np
import rclpy
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from sensor_msgs.msg import Image


def changing(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """Change size and encoding with every image, and come back to the first."""
    others = [Image(width=width, height=height, encoding=encoding, step=width * size,
                    data=bytes(width * height * size))
              for width, height, encoding, size in (
                  (320, 240, 'mono8', 1), (640, 480, 'rgba8', 4), (100, 80, 'yuv422', 2),
                  (33, 21, 'bgr16', 6))]
    with tracking_node(sender):
        sender.stream(seconds, lambda number: sender.send(
            image=[None, *others][number % (len(others) + 1)]))
        sender.select()
        return sender.row([sender.recovery()])


def half_lost(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """Send each image with a probability of a half."""
    rng = np.random.default_rng(0)
    with tracking_node(sender):
        sender.stream(seconds, lambda number: sender.send() if rng.random() < 0.5 else None)
        return sender.row([sender.recovery()])


def flood(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """Send tiny images at up to 1,000 Hz."""
    tiny = Image(width=16, height=16, encoding='bgr8', step=48, data=bytes(768))
    with tracking_node(sender) as process:
        before, due = rss_mb(process.pid), time.perf_counter()
        for number in range(round(1000 * seconds)):
            sender.send(sender.index * PERIOD + number * 10**6, tiny)
            due += 1e-3
            if (left := due - time.perf_counter()) > 0:
                time.sleep(left)
            sender.bench.executor.spin_once(timeout_sec=0)
        took = time.perf_counter() - due + seconds
        sender.index += round(seconds * RATE) + 1
        # A selection is for the next image, which mustn't be one of the flood's last.
        sender.bench.rest(1.0)
        sender.select()
        return sender.row([sender.recovery()], rate_hz=1000 * seconds / took,
                          growth_mb=rss_mb(process.pid) - before)


def huge(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """Send one image of 7680 x 4320, twice what the shared memory holds."""
    image = Image(width=7680, height=4320, encoding='bgr8', step=3 * 7680)
    image.data = array('B', bytes(3 * 7680 * 4320))
    with tracking_node(sender) as process:
        before = rss_mb(process.pid)
        sender.index += 1
        sender.send(image=image)
        sender.bench.rest(seconds)
        heard = sender.answers
        sender.index += round(seconds * RATE)
        if heard:
            sender.select()
        return sender.row([sender.recovery()], huge_answered=heard,
                          growth_mb=rss_mb(process.pid) - before)


def storm(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """Let four clients set valid and invalid parameters, as fast as they're answered."""
    done = threading.Event()
    counts = {'set': 0, 'refused': 0}

    def ask(seed: int) -> None:
        context = rclpy.Context()
        rclpy.init(args=[], context=context)
        asking = rclpy.create_node(f'client_{seed}', context=context)
        executor = rclpy.executors.SingleThreadedExecutor(context=context)
        executor.add_node(asking)
        client = AsyncParameterClient(asking, '/ours/tracker')
        client.wait_for_services(PATIENCE)
        rng = np.random.default_rng(seed)
        while not done.is_set():
            name, value = [('gmpf.particles', int(rng.integers(-50, 200))), ('seed', seed),
                           ('pose_units', 'miles'), ('gmpf.floor', float(rng.uniform(-1, 5)))][
                               rng.integers(4)]
            future = client.set_parameters([Parameter(name, value=value)])
            executor.spin_until_future_complete(future, timeout_sec=5)
            if future.done():
                counts['set' if future.result().results[0].successful else 'refused'] += 1
        rclpy.try_shutdown(context=context)

    with tracking_node(sender):
        threads = [threading.Thread(target=ask, args=(seed,)) for seed in range(4)]
        for thread in threads:
            thread.start()
        sender.stream(seconds)
        done.set()
        for thread in threads:
            thread.join()
        return sender.row([sender.recovery()], **counts)


FAULTS = {
    'another size and encoding every frame': changing,
    'every second frame lost, at random': half_lost,
    '16 x 16 images at 1,000 Hz': flood,
    'one image of 7680 x 4320': huge,
    'four clients setting parameters': storm,
}
