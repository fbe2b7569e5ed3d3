"""Parameters over real services: declared from the table, set or refused, in force at once."""

import math

from node_harness import Client, NodeProcess, overlap, Scene, STEP
import pytest
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import (
    DescribeParameters, ListParameters, SetParameters, SetParametersAtomically)
from rclpy.parameter import Parameter
from siamese_files import network_files
from std_srvs.srv import SetBool
from vision_msgs.msg import BoundingBox2D, Detection2D

from vtrack_ros.ros.parameter_node import parameter_table
from vtrack_ros.trackers import tracker_class, tracker_names

TYPES = {bool: ParameterType.PARAMETER_BOOL, int: ParameterType.PARAMETER_INTEGER,
         float: ParameterType.PARAMETER_DOUBLE, str: ParameterType.PARAMETER_STRING}


@pytest.fixture(scope='module')
def talk():
    """Return a scene and a client of a node that starts on the scene's first box."""
    scene = Scene()
    box = scene.box(0)
    text = f'[{box.x}, {box.y}, {box.width}, {box.height}]'
    with NodeProcess(init_box=text) as process, Client() as client:
        client.ready()
        for index, answer in enumerate(client.play(scene, range(5))):
            assert overlap(answer, scene.box(index)) > 0.5, process.log
        client.index = 5
        yield scene, client


def tracks_on(talk, frames=3):
    """Say whether the node follows the target through the next frames."""
    scene, client = talk
    start, client.index = client.index, client.index + frames
    answers = client.play(scene, range(start, start + frames))
    return all(overlap(answer, scene.box(start + i)) > 0.4 for i, answer in enumerate(answers))


def test_declared_from_the_table(talk):
    """Every row of the table is a parameter with its default, range and description."""
    _, client = talk
    table = parameter_table()
    for tracker in tracker_names():
        for name in tracker_class(tracker).PARAMETERS:
            assert f'{tracker}.{name}' in table
    listed = client.ask('~/list_parameters', ListParameters).result.names
    assert set(table) | {'init_box'} <= set(listed)
    names = list(table)
    described = client.ask('~/describe_parameters', DescribeParameters, names=names).descriptors
    values = client.get(*names)
    for row, told, value in zip(table.values(), described, values):
        assert value == row.default and type(value) is row.kind
        assert told.type == TYPES[row.kind]
        assert row.description in told.description
        assert told.read_only == (not row.dynamic)
        ranges = [*told.integer_range, *told.floating_point_range]
        if row.low is not None and row.high is not None:
            assert (ranges[0].from_value, ranges[0].to_value) == (row.low, row.high)
        else:
            assert ranges == [] or row.low is not None or row.high is not None
        for choice in row.choices:
            assert str(choice) in told.description


@pytest.mark.parametrize('name, value, told', [
    ('gmpf.particles', 0, ['gmpf.particles', '2', '5000', '0']),
    ('gmpf.particles', 10**9, ['gmpf.particles', '5000']),
    ('gmpf.particles', 'many', ['gmpf.particles', 'integer', '5000', 'many']),
    ('gmpf.particles', 20.5, ['gmpf.particles', 'integer', '5000', '20.5']),
    ('gmpf.temperature', -1.0, ['gmpf.temperature', '0.01', '1', '-1.0']),
    ('gmpf.temperature', math.nan, ['gmpf.temperature', 'nan']),
    ('gmpf.temperature', math.inf, ['gmpf.temperature', 'inf']),
    ('gmpf.temperature', 1, ['gmpf.temperature', '1.0', 'not 1']),
    ('tracker', 'csrt', ['tracker', 'gmpf', 'pf', 'csrt']),
    ('tracker', 3, ['tracker', 'gmpf', '3']),
    ('abmspf_paper.levels', 12, ['abmspf_paper.levels', '8, 16', 'not 12']),
    ('abmspf_paper.levels', '8', ['abmspf_paper.levels', '8, 16', "not '8'"]),
    ('seed', -1, ['seed', '0', '-1']),
    ('init_class', 0, ['init_class must be text, in quotes: "\'0\'", not 0']),
    ('init_box', [1.0, 2.0, 3.0], ['init_box', '3 values', 'width']),
    ('init_box', [1.0, 2.0, -3.0, 4.0], ['init_box', 'positive', '-3']),
    ('init_box', [1.0, math.nan, 3.0, 4.0], ['init_box', 'finite']),
    ('init_box', 'here', ['init_box', 'here', 'width']),
    ('init_box', ['1', '2', '3', '4'], ['init_box', 'width']),
    ('image_transport', 'compressed', ['read-only', 'image_transport']),
    ('target_width', -0.1, ['target_width', '0', '1000 m', '-0.1']),
    ('pose_units', 'feet', ['pose_units', 'metres', 'feet']),
    ('gmpf.nonsense', 1, ['gmpf.nonsense', 'gmpf.particles']),
    ('nonsense', 1, ['nonsense', 'tracker', 'init_box', 'gmpf']),
])
def test_refused_with_reason_and_range(talk, name, value, told):
    """A wrong value is refused, says what's valid, changes nothing, and the tracking goes on."""
    _, client = talk
    known = name in parameter_table() or name == 'init_box'
    before = client.get(name) if known else None
    result, = client.change(**{name.replace('.', '__'): value})
    assert not result.successful
    for part in told:
        assert part in result.reason
    if known:
        assert client.get(name) == before
    assert tracks_on(talk, 1)


def test_refused_atomically(talk):
    """An atomic change with one wrong value changes nothing."""
    _, client = talk
    before = client.get('gmpf.particles', 'tracker', 'seed')
    result = client.set_atomically(seed=7, gmpf__particles=77, tracker='nobody')
    assert not result.successful and 'nobody' in result.reason
    assert client.get('gmpf.particles', 'tracker', 'seed') == before
    assert tracks_on(talk, 1)


@pytest.mark.parametrize('rows, told', [
    ([('start_type_description_service', False)], 'read-only'),
    ([('use_sim_time', 1)], 'expected'),
    ([('gmpf.particles', -1), ('gmpf.particles', 77)], 'an integer from 2 to 5000, not -1'),
])
def test_refused_by_ros_changes_nothing(talk, rows, told):
    """A wrong value of a parameter of ROS, or of one given twice, doesn't change the tracker."""
    scene, client = talk
    before = client.get('tracker', 'gmpf.particles')
    request = [Parameter(name, value=value).to_parameter_msg()
               for name, value in [('tracker', 'pf'), *rows]]
    result = client.ask(
        '~/set_parameters_atomically', SetParametersAtomically, parameters=request).result
    assert not result.successful and told in result.reason
    assert client.get('tracker', 'gmpf.particles') == before
    start, client.index = client.index, client.index + 1
    answer, = client.play(scene, [start])
    assert client.state_after(answer)['tracker'] == 'gmpf'
    assert overlap(answer, scene.box(start)) > 0.4


def test_a_request_that_cannot_be_read_ends_nothing(talk):
    """After a value of a type that doesn't exist the node goes on tracking."""
    from rcl_interfaces.msg import Parameter as ParameterMessage, ParameterValue
    _, client = talk
    caller = client.node.create_client(SetParameters, '/tracker/set_parameters')
    assert caller.wait_for_service(10)
    caller.call_async(SetParameters.Request(parameters=[
        ParameterMessage(name='seed', value=ParameterValue(type=99))]))
    assert tracks_on(talk, 2)
    client.node.destroy_client(caller)


def test_in_force_on_the_next_frame(talk):
    """The first frame after the answer is tracked with the new number of particles."""
    from geometry_msgs.msg import PoseArray
    _, client = talk
    particles = client.heard.get('~/particles') or client.hear('~/particles', PoseArray)
    client.until(lambda: client.node.count_publishers('/tracker/particles'), 'no particles')
    client.until(lambda: tracks_on(talk, 1) and particles, 'no particles were heard')
    for count in (40, 300, 150):
        assert client.change(gmpf__particles=count)[0].successful
        heard = len(particles)
        assert tracks_on(talk, 1)
        client.until(lambda: len(particles) > heard, 'no particles were heard')
        assert len(particles[-1].poses) == count
        assert client.get('gmpf.particles') == [count]


def test_another_tracker_keeps_the_target(talk):
    """Every tracker continues at the previous one's target."""
    scene, client = talk
    for tracker in (*tracker_names(replicas=False), 'gmpf'):
        assert client.change(tracker=tracker)[0].successful
        start, client.index = client.index, client.index + 2
        answers = client.play(scene, range(start, start + 2))
        assert all(answer.detections for answer in answers), tracker
        assert overlap(answers[0], scene.box(start)) > 0.25, tracker
        client.until(lambda: client.heard['~/state'][-1].hardware_id == tracker, tracker)
        # Start on the true box again, so that errors don't accumulate.
        box = scene.box(start + 1)
        assert client.change(init_box=[box.x, box.y, box.width, box.height])[0].successful
        assert tracks_on(talk, 1)


def test_another_localiser_keeps_the_target(talk):
    """A network continues at once; without its files, or with a wrong one, nothing changes."""
    _, client = talk
    refused = client.change(gmpf__localiser='siamese', gmpf__siamese__head='/nowhere.onnx')
    assert not any(result.successful for result in refused)
    assert 'siamese.backbone' in refused[0].reason and 'is not a file' in refused[1].reason
    files = {f'gmpf__{name}'.replace('.', '__'): path for name, path in network_files().items()}
    assert client.set_atomically(gmpf__localiser='siamese', **files).successful
    assert tracks_on(talk, 2)
    assert client.change(gmpf__localiser='dcf')[0].successful
    assert tracks_on(talk, 2)


def test_a_tracker_of_opencv_knows_no_covariance(talk):
    """Its covariance is all 0, unknown in ROS; a tracker whose files aren't named is refused."""
    scene, client = talk
    refused = client.change(tracker='opencv_vit')[0]
    assert not refused.successful and 'opencv_vit needs' in refused.reason
    assert client.change(tracker='opencv_mil')[0].successful
    start, client.index = client.index, client.index + 1
    [answer] = client.play(scene, range(start, start + 1))
    assert not any(answer.detections[0].results[0].pose.covariance)
    assert client.change(tracker='gmpf')[0].successful
    assert tracks_on(talk, 1)


def test_a_tracker_that_cannot_take_over_while_paused():
    """The log says that the target is forgotten, and why, as it does while tracking."""
    with NodeProcess('-r', '__ns:=/paused', init_box='[60, 40, 4, 4]') as process, (
            Client('/paused/tracker')) as client:
        client.ready().send(Scene().frame(0), 10**9)
        assert client.ask('~/enable', SetBool, data=False).success
        # it can't start on so small a box
        assert client.change(tracker='opencv_mil')[0].successful
        process.wait_for_log('opencv_mil cannot start on the target: it is forgotten (ValueError')


def test_init_box_takes_integers_floats_and_nothing(talk):
    """init_box may be four integers or four floats; an empty one keeps the present target."""
    scene, client = talk
    box = scene.box(client.index)
    numbers = [box.x, box.y, box.width, box.height]
    assert client.change(init_box=[int(number) for number in numbers])[0].successful
    assert tracks_on(talk, 1)
    assert client.change(init_box=[])[0].successful
    assert tracks_on(talk, 2)


def test_choices_of_integers(talk, tmp_path):
    """A parameter with integer choices takes an integer, while the node runs and in a file."""
    _, client = talk
    assert client.change(abmspf_paper__levels=8)[0].successful
    assert client.get('abmspf_paper.levels') == [8]
    path = tmp_path / 'parameters.yaml'
    path.write_text('/**:\n  ros__parameters:\n    abms_paper:\n      levels: 8\n')
    with NodeProcess('-r', '__ns:=/levels', '--params-file', str(path)), (
            Client('/levels/tracker')) as other:
        other.ready()
        assert other.get('abms_paper.levels') == [8]


@pytest.mark.parametrize('by_file', [False, True])
def test_init_box_may_be_empty_from_the_start(tmp_path, by_file):
    """The default, an empty init_box, may be given: nothing is selected; a box may follow."""
    path = tmp_path / 'parameters.yaml'
    path.write_text('/**:\n  ros__parameters:\n    init_box: []\n')
    arguments = ['--params-file', str(path)] if by_file else ['-p', 'init_box:=[]']
    with NodeProcess('-r', '__ns:=/empty', *arguments) as process, (
            Client('/empty/tracker')) as client:
        process.wait_for_log('select the target while images arrive: in the browser (vtrack '
                             'select /empty/tracker), on /empty/tracker/init_roi')
        client.ready()
        assert list(client.get('init_box')[0]) == []
        assert client.change(init_box=[10.0, 10.0, 30.0, 30.0])[0].successful
        assert list(client.get('init_box')[0]) == [10.0, 10.0, 30.0, 30.0]


@pytest.mark.parametrize('name, value, told', [
    ('gmpf.particles', '0', ['gmpf.particles', '5000']),
    ('tracker', 'csrt', ['csrt', 'gmpf']),
    ('pose_units', 'metre', ['pose_units', 'pixels, ray, metres', "not 'metre'"]),
    ('image_transport', 'theora', ['image_transport', 'raw, compressed', "not 'theora'"]),
    ('reliability', 'best-effort', ['reliability', 'best_effort', "not 'best-effort'"]),
    ('init_box', '[1.0, 2.0]', ['2 values', 'width']),
    ('gmpf.temperature', 'wide', ['gmpf.temperature', 'a number from', "not 'wide'"]),
    ('init_class', '7', ['init_class must be text, in quotes: "\'7\'", not 7']),
    ('history_seconds', '3', ['history_seconds', 'from 0 to 30', 'decimal point: 3.0']),
    ('init_box', '[300, 200.5, 60, 80]', ['same type', '[300.0, 200.0, 60.0, 80.0]']),
])
def test_wrong_from_the_start(name, value, told):
    """A node that is started with a wrong value prints the reason, and ends with code 2."""
    process = NodeProcess(**{name: value})
    assert process.process.wait(20) == 2
    process.stop()
    for part in told:
        assert part in process.log
    assert 'Traceback' not in process.log


@pytest.mark.parametrize('arguments, code, told', [
    (['--params-file', 'nowhere.yaml'], 2, 'nowhere.yaml'),
    (['-r', 'nonsense'], 2, 'remap rule'),
    (['nonsense'], 2, "unknown ROS arguments ['nonsense']; valid are -r"),
    (['--', '--nonsense'], 2, "unknown argument '--nonsense'"),
    (['--', '--help'], 0, 'init_box'),
])
def test_arguments(arguments, code, told):
    """Invalid arguments are named, and end the node with code 2; --help prints the usage."""
    process = NodeProcess(*arguments)
    assert process.process.wait(20) == code
    process.stop()
    assert told in process.log and 'Traceback' not in process.log


def test_middleware_that_refuses(tmp_path):
    """A node that DDS security rejects (no keys, or no support) prints the error; code 2."""
    (tmp_path / 'enclaves' / 'vtrack' / 'tracker').mkdir(parents=True)
    secured = {'ROS_SECURITY_KEYSTORE': str(tmp_path), 'ROS_SECURITY_ENABLE': 'true',
               'ROS_SECURITY_STRATEGY': 'Enforce'}
    process = NodeProcess('--enclave', '/vtrack/tracker',
                          prelude=f'import os; os.environ.update({secured})')
    assert process.process.wait(20) == 2
    process.stop()
    last = process.log.splitlines()[-1]
    assert last.startswith('tracker: error creating node: ') and 'ecurity' in last
    assert 'Traceback' not in process.log


def test_a_person_may_take_seconds_to_draw_a_box():
    """By default a box on a colour image of 1280 x 720 is taken 2.6 s later, at 30 Hz."""
    scene = Scene(1280, 720, 96)
    with NodeProcess('-r', '__ns:=/hd') as process, Client('/hd/tracker') as client:
        select = client.ready().publisher('~/init', Detection2D)
        answers = client.play(scene, range(78))
        box = BoundingBox2D(size_x=96.0, size_y=96.0)
        box.center.position.x, box.center.position.y = scene.box(0).center
        select.publish(Detection2D(header=answers[0].header, bbox=box))
        for index in range(78, 88):
            answer = client.send(scene.frame(index), 10**9 + index * STEP)
            if answer.detections:
                break
        assert answer.detections and overlap(answer, scene.box(index)) > 0.5, process.log


@pytest.mark.parametrize('missing', ['rclpy', 'sensor_msgs'])
def test_without_ros(missing):
    """One line says what is missing and how to install it; the exit code is 2."""
    process = NodeProcess(prelude=f'sys.modules[{missing!r}] = None')
    assert process.process.wait(20) == 2
    process.stop()
    line, = process.log.splitlines()
    assert missing in line and 'setup.bash' in line and 'vtrack_ros[ros]' in line
