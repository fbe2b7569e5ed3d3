"""Setting a parameter checks it once, and only creates a tracker where one is needed."""

from collections import Counter

import pytest
import rclpy
from rclpy.context import Context
from rclpy.parameter import Parameter as RosParameter

from vtrack_ros.parameters import Parameter
from vtrack_ros.ros.tracker_node import TrackerNode
from vtrack_ros.session import session
from vtrack_ros.trackers import create_tracker


@pytest.fixture
def work(monkeypatch):
    """Return counts of the checks of every parameter, and of the trackers that are created."""
    counted = Counter()
    check = Parameter.checked

    def counting_check(row, value):
        counted[row.name] += 1
        return check(row, value)

    def counting_create(name, **arguments):
        counted[f'make {name}'] += 1
        return create_tracker(name, **arguments)
    monkeypatch.setattr(Parameter, 'checked', counting_check)
    monkeypatch.setattr(session, 'create_tracker', counting_create)
    return counted


@pytest.fixture
def node(work):
    """Return a node in this process."""
    context = Context()
    rclpy.init(context=context, args=[])
    node = TrackerNode(context=context)
    yield node
    node.destroy_node()
    rclpy.try_shutdown(context=context)


def test_only_the_tracker_in_use_is_made_at_the_start(node, work):
    """Only gmpf is created; the other trackers' parameters are checked by their tables."""
    assert [name for name in work if name.startswith('make')] == ['make gmpf']


@pytest.mark.parametrize('name, value, made', [
    ('gmpf.particles', 80, {}), ('pf.particles', 80, {}), ('seed', 3, {}),
    ('tracker', 'pf', {'make pf': 1})])
def test_once_is_enough(node, work, name, value, made):
    """The value is checked once; a tracker is only created if another one is chosen."""
    work.clear()
    result = node.set_parameters_atomically([RosParameter(name, value=value)])
    assert result.successful
    own = name.split('.')[-1]
    assert work[own] == 1
    assert {key: count for key, count in work.items() if key.startswith('make')} == made
    assert max(work.values()) == 1


def test_a_refused_value_changes_nothing(node, work):
    """An atomic change with a wrong value sets none; without `atomically` the valid one is set."""
    wrong = [RosParameter('seed', value=5), RosParameter('gmpf.particles', value=0)]
    assert not node.set_parameters_atomically(wrong).successful
    assert node.get_parameter('seed').value == 0
    assert node.get_parameter('gmpf.particles').value == 150
    one_by_one = node.set_parameters(wrong)
    assert [result.successful for result in one_by_one] == [True, False]
