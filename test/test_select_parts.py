"""What the page is made of: who may see it, its inputs, and its link to the node."""

import asyncio
import sys
import threading
import time

import aiohttp
from node_harness import PATIENCE
from page_viewer import viewer
import pytest
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.parameter import Parameter

from vtrack_ros.selecting.access import is_loopback
from vtrack_ros.selecting.observer import Observer
from vtrack_ros.selecting.parameter_inputs import parameter_inputs, parameter_value
from vtrack_ros.selecting.server import serve
from vtrack_ros.selecting.tracker_link import TrackerLink


@pytest.mark.parametrize('host, own', [
    ('localhost', True), ('127.0.0.1', True), ('127.1.2.3', True), ('::1', True), ('', False),
    ('10.0.0.1', False), ('localhost.example', False), ('127.0.0.1.example', False)])
def test_loopback(host, own):
    """Only this machine's own names are its own."""
    assert is_loopback(host) is own


def test_inputs_from_descriptors():
    """A range without an end has none; what can't change or isn't a scalar is left out."""
    described = [
        ParameterDescriptor(name='half', floating_point_range=[
            FloatingPointRange(from_value=0.0, to_value=sys.float_info.max)]),
        ParameterDescriptor(name='whole', integer_range=[
            IntegerRange(from_value=-2**63, to_value=7)]),
        ParameterDescriptor(name='fixed', read_only=True), ParameterDescriptor(name='list'),
        ParameterDescriptor(name='one', additional_constraints='valid: one of a, b')]
    values = [Parameter('', value=value).get_parameter_value()
              for value in (1.5, 3, True, [1.0], 'b')]
    assert parameter_inputs(described, values) == [
        {'name': 'half', 'kind': 'float', 'value': 1.5, 'text': '', 'low': 0.0},
        {'name': 'whole', 'kind': 'int', 'value': 3, 'text': '', 'high': 7},
        {'name': 'one', 'kind': 'text', 'value': 'b', 'text': '', 'choices': ['a', 'b']}]
    assert parameter_value('float', 2).double_value == 2.0
    for kind, value in (('int', True), ('int', '3'), ('int', 2**63), ('bool', 1), ('list', [])):
        with pytest.raises(ValueError, match='no value of kind'):
            parameter_value(kind, value)


def test_it_closes_between_callbacks(monkeypatch):
    """A look at the graph that has begun ends before its context does."""
    begun, raised, look = threading.Event(), [], Observer.look

    def slow(one):
        begun.set()
        time.sleep(0.3)
        look(one)
    monkeypatch.setattr(Observer, 'look', slow)
    monkeypatch.setattr(threading, 'excepthook', raised.append)

    async def main():
        link = TrackerLink('/nobody', lambda: None, lambda text: None)
        await asyncio.to_thread(begun.wait, PATIENCE)
        link.close()
    asyncio.run(main())
    assert begun.is_set() and not raised


def test_what_fails_is_not_hidden(monkeypatch, capsys, caplog, tmp_path):
    """A viewer of which a part failed is closed, and it's told why; the page comes again."""
    async def broken(self):
        raise RuntimeError('out of order')
    monkeypatch.setattr(TrackerLink, 'reachable', True)
    monkeypatch.setattr(TrackerLink, 'parameters', broken)

    async def main():
        serving = asyncio.create_task(serve('/nobody', '127.0.0.1', 0, '', tmp_path))
        while not (output := capsys.readouterr().out):
            await asyncio.sleep(0.01)
        async with viewer(output.split()[0]) as seen:
            assert (await seen.socket.receive(PATIENCE)).type is aiohttp.WSMsgType.CLOSED
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)
    asyncio.run(main())
    assert 'out of order' in caplog.text
