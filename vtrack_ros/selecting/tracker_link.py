"""The connection to a tracking node: its topics, services and parameters, for asyncio."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from pathlib import Path
import threading
from typing import Any

from geometry_msgs.msg import PointStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger
from vision_msgs.msg import Detection2D

from vtrack_ros.dds import leave
from vtrack_ros.geometry import Box
from vtrack_ros.selecting.observer import Observer
from vtrack_ros.selecting.parameter_inputs import parameter_inputs, parameter_value

#: Time-out of a call to a service of the node, in seconds.
SERVICE_TIMEOUT = 5.0
_SERVICES: dict[str, Any] = {
    'reset': Trigger, 'reinit': Trigger, 'larger': Trigger, 'smaller': Trigger, 'enable': SetBool,
    'list_parameters': ListParameters, 'describe_parameters': DescribeParameters,
    'get_parameters': GetParameters, 'set_parameters': SetParameters}


class TrackerLink:
    """
    A ROS node that watches a tracking node and selects its target, spun in a thread of its own.

    `target` is the tracking node's full name; the callbacks are called in the thread of the event
    loop that was running when it was made. `close` has to be called in the end.
    """

    def __init__(self, target: str, changed: Callable[[], None], said: Callable[[str], None],
                 configured: Callable[[dict[str, Any]], None]) -> None:
        loop = asyncio.get_running_loop()
        self.target = target
        self._context = Context()
        # The event loop handles the signals.
        rclpy.init(args=[], context=self._context,
                   signal_handler_options=rclpy.SignalHandlerOptions.NO)
        self._node = Node('vtrack_select', context=self._context)
        self._boxes = self._node.create_publisher(Detection2D, f'{target}/init', 1)
        self._points = self._node.create_publisher(PointStamped, f'{target}/init_point', 1)
        self._clients = {name: self._node.create_client(kind, f'{target}/{name}')
                         for name, kind in _SERVICES.items()}

        def later(call: Callable[..., None], *arguments: Any) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(call, *arguments)
        self._observer = Observer(self._node, target, *(
            partial(later, call) for call in (changed, said, configured)))
        self.picture = self._observer.picture
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._spin, name='ros')
        self._thread.start()

    @property
    def reachable(self) -> bool:
        """Return whether the node's services are there, and it subscribes to selections."""
        return (all(client.service_is_ready() for client in self._clients.values())
                and all(one.get_subscription_count() for one in (self._boxes, self._points)))

    @property
    def state(self) -> dict[str, str]:
        """Return the node's state, as `Observer.state`."""
        return self._observer.state

    @property
    def recording(self) -> bool:
        """Return whether a recording is being made."""
        return self._observer.recording

    def watch(self, on: bool) -> None:
        """Start or stop receiving images."""
        self._observer.watched = on
        self._executor.create_task(self._observer.look)

    def want_particles(self, on: bool) -> None:
        """Start or stop receiving particles with the images."""
        self._observer.wanted = on
        self._executor.create_task(self._observer.look)

    async def record(self, folder: Path | None) -> str:
        """
        Start recording to a bag in a folder, or with None finish it; return a text that says so.

        BagError if it can't be written, ModuleNotFoundError without rosbags; TimeoutError if the
        disk takes long, which doesn't undo it.
        """
        done: Future[str] = _begun()

        def work() -> None:
            try:
                done.set_result(self._observer.finish_recording() if folder is None else
                                self._observer.record(folder))
            except (OSError, ValueError, ModuleNotFoundError) as error:
                done.set_exception(error)
        self._executor.create_task(work)
        try:
            return await asyncio.wait_for(asyncio.wrap_future(done), SERVICE_TIMEOUT)
        except TimeoutError:
            place = '' if folder is None else f' of {folder.absolute()}'
            raise TimeoutError(f'the disk{place} is slow: it has not answered within '
                               f'{SERVICE_TIMEOUT:g} s, and will when it can') from None

    def select_box(self, stamp: int, box: Box) -> None:
        """Select the target by a box on the image of a stamp [ns]; errors as `ask`."""
        message = Detection2D()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.bbox.center.position.x, message.bbox.center.position.y = box.center
        message.bbox.size_x, message.bbox.size_y = box.width, box.height
        self._publish(self._boxes, message)

    def select_point(self, stamp: int, x: float, y: float) -> None:
        """Select the target by a point on the image of a stamp [ns]; errors as `ask`."""
        message = PointStamped()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.point.x, message.point.y = x, y
        self._publish(self._points, message)

    async def ask(self, service: str, **fields: Any) -> Any:
        """Call a service of the node; TimeoutError if it's missing or doesn't answer."""
        client, kind = self._clients[service], _SERVICES[service]
        answer: Future[Any] = _begun()
        if not client.service_is_ready():
            raise TimeoutError(f'there is no service {self.target}/{service}: is the node '
                               f'{self.target} running?')
        request = client.call_async(kind.Request(**fields))
        request.add_done_callback(lambda future: answer.set_result(future.result()))
        try:
            return await asyncio.wait_for(asyncio.wrap_future(answer), SERVICE_TIMEOUT)
        except TimeoutError:
            client.remove_pending_request(request)
            raise TimeoutError(
                f'{self.target}/{service} did not answer within {SERVICE_TIMEOUT:g} s') from None

    async def parameters(self) -> list[dict[str, Any]]:
        """Return the parameters as `parameter_inputs`; errors as `ask`."""
        listed = await self.ask('list_parameters')
        names = list(listed.result.names)
        described = await self.ask('describe_parameters', names=names)
        values = await self.ask('get_parameters', names=names)
        return parameter_inputs(described.descriptors, values.values)

    async def set_parameter(self, name: str, kind: str, value: Any) -> str:
        """Set a parameter; return why it failed, or ''. Errors as `ask`."""
        try:
            given = parameter_value(kind, value)
        except (ValueError, OverflowError) as error:
            if kind not in ('int', 'float'):
                return f'{name}: {error}'
            # such as an empty input: the node refuses text for a number, and says what is valid
            given = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=str(value))
        row = Parameter(name=name, value=given)
        result, = (await self.ask('set_parameters', parameters=[row])).results
        return '' if result.successful else str(result.reason)

    def close(self) -> None:
        """Take the node down."""
        # before the context goes: a callback may be running, and shutdown wouldn't wait for it
        self._closing.set()
        self._thread.join()
        self._executor.shutdown()
        rclpy.try_shutdown(context=self._context)
        self._observer.destroy()
        leave(self._node)

    @staticmethod
    def _publish(publisher: Any, message: Any) -> None:
        """Publish; TimeoutError without a subscriber: the message would be lost silently."""
        if not publisher.get_subscription_count():
            raise TimeoutError(f'no node subscribes to {publisher.topic_name}')
        publisher.publish(message)

    def _spin(self) -> None:
        while not self._closing.is_set():
            self._executor.spin_once(timeout_sec=0.2)


def _begun() -> Future[Any]:
    """Return a future that another thread sets, even after the wait for it was given up."""
    future: Future[Any] = Future()
    future.set_running_or_notify_cancel()
    return future
