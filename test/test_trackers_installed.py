"""Trackers of other packages: the documentation's example, and invalid entry points."""

import asyncio
from collections.abc import Iterable
import os
from pathlib import Path
import shutil
import subprocess
import sys
import tomllib

from bag_material import write_short_bag
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from node_harness import Client, NodeProcess, overlap, Scene
from page_viewer import serving, viewer
import pytest
from std_srvs.srv import Trigger
from vtrack_ros.trackers import tracker_names

#: Invalid entry points, and part of the warning about each.
WRONG = {
    'broken = no_such_module:Tracker': "No module named 'no_such_module'",
    'other = steady_tracker:SteadyTracker': "NAME is 'steady'",
    'base = vtrack_ros.tracker:Tracker': 'not a subclass',
    'gmpf = vtrack_ros.trackers.dcf:CorrelationTracker': "NAME is 'dcf'",
    'dcf = vtrack_ros.trackers.dcf:CorrelationTracker': 'not that of another'}


def register(folder: Path, name: str, rows: Iterable[str],
             group: str = 'vtrack_ros.trackers', version: str = '1.0') -> None:
    """Write what pip does of an installed package: its name, version and entry points."""
    information = folder / f'{name}-{version}.dist-info'
    information.mkdir()
    (information / 'METADATA').write_text(
        f'Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n')
    (information / 'entry_points.txt').write_text('\n'.join([f'[{group}]', *rows]))


@pytest.fixture(scope='module')
def site(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the example as pip installs it, and with invalid entry points."""
    folder = tmp_path_factory.mktemp('site')
    sources = repository / 'docs' / 'examples' / 'steady_tracker'
    shutil.copy(sources / 'steady_tracker.py', folder)
    project = tomllib.loads((sources / 'pyproject.toml').read_text())['project']
    [(group, points)] = project['entry-points'].items()
    rows = [f'{name} = {value}' for name, value in points.items()]
    register(folder, project['name'], [*rows, *WRONG], group, project['version'])
    return folder


def test_library_and_command_line(site, repository, tmp_path):
    """They have the tracker; invalid ones are warned of, and don't affect the others."""
    code = f"""
from vtrack_ros.cli.command_line import main
from vtrack_ros.evaluation.cache import source_files
from vtrack_ros.evaluation.tracker_specification import parse_trackers
from vtrack_ros.trackers import create_tracker, tracker_names
assert create_tracker('steady', seed=0, share=0.5).parameters == {{'share': 0.5}}
assert type(create_tracker('gmpf')).__name__ == 'GreyParticleFilter'
assert tracker_names(replicas=False) == {tracker_names(replicas=False)} + ('steady',)
assert 'steady' in [one.name for one in parse_trackers('all')]
files = source_files('steady_tracker')
assert {{'steady_tracker', 'vtrack_ros.localisation.localiser'}} < set(files)
bag = {str(write_short_bag(tmp_path / 'bag', repository))!r}
assert main(['replay', bag, '--tracker', 'steady', '--set', 'share=0.9', '--json']) == 0
assert main(['evaluate', '--bags', bag, '--trackers', 'steady', '--jobs', '1', '--no-cache']) == 0
assert main(['replay', bag, '--tracker', 'steady', '--set', 'share=9']) == 2
"""
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join((str(repository), str(site)))})
    assert done.returncode == 0, done.stderr
    assert 'steady ' in done.stdout
    assert 'share must be a number from 0.1 to 1' in done.stderr
    for row, words in WRONG.items():
        [line] = [line for line in done.stderr.splitlines()
                  if f'tracker {row.split()[0]!r}' in line]
        assert words in line


FAULTY = """
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.trackers.dcf import CorrelationTracker

class Faulty(CorrelationTracker):
    NAME, SUMMARY = 'faulty', 'fails'
    PARAMETERS = ParameterTable([
        *CorrelationTracker.PARAMETERS.values(),
        Parameter('file', '', 'Opened.'), Parameter('fails', False, 'Whether it cannot start.')])

    def _prepare(self, values):
        if values['file']:
            open(values['file']).close()
        super()._prepare(values)

    def _start(self, frame, box):
        if self.parameters['fails']:
            raise RuntimeError('no such device')
        return super()._start(frame, box)
"""


def test_faults_are_answered_and_told(tmp_path):
    """Whatever a tracker raises, transitions and requests are answered, and the reason is said."""
    (tmp_path / 'faulty.py').write_text(FAULTY)
    register(tmp_path, 'faulty', ['faulty = faulty:Faulty'])
    file, scene = tmp_path / 'model', Scene()
    file.touch()
    prelude = f'sys.path.append({str(tmp_path)!r})'
    with NodeProcess('-r', '__ns:=/faulty', prelude=prelude, entry='lifecycle_main',
                     tracker='faulty', faulty__fails='true') as node, (
            Client('/faulty/tracker')) as client:
        assert client.parameters.wait_for_services(20)

        def change(transition):
            return client.ask('~/change_state', ChangeState,
                              transition=Transition(id=transition)).success
        assert not change(Transition.TRANSITION_CONFIGURE)
        node.wait_for_log('not configured: faulty fails: RuntimeError: no such device')
        refused = client.change(faulty__file=str(file) + '2')[0]
        assert not refused.successful and 'faulty: FileNotFoundError' in refused.reason
        box = list(map(float, scene.box(0).as_array()))
        assert client.set_atomically(
            faulty__file=str(file), faulty__fails=False, init_box=box).successful
        assert change(Transition.TRANSITION_CONFIGURE) and change(Transition.TRANSITION_ACTIVATE)
        client.ready().play(scene, range(3))
        file.unlink()
        answer = client.ask('~/reinit', Trigger)
        assert not answer.success
        assert answer.message.startswith('the target is kept as it was: faulty: FileNotFoundError')
        assert overlap(client.play(scene, range(3, 6))[-1], scene.box(5)) > 0.4
    alone = NodeProcess(prelude=prelude, tracker='faulty', faulty__fails='true')
    assert alone.process.wait(20) == 2
    assert alone.log.splitlines() == ['tracker: faulty fails: RuntimeError: no such device']


NAMED = """
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.trackers.dcf import CorrelationTracker

class Named(CorrelationTracker):
    NAME, SUMMARY = 'named', 'has a parameter `name`'
    PARAMETERS = CorrelationTracker.PARAMETERS + ParameterTable([Parameter('name', '', 'A name.')])

class Seeded(CorrelationTracker):
    NAME, SUMMARY = 'seeded', 'has a parameter `seed`'
    PARAMETERS = CorrelationTracker.PARAMETERS + ParameterTable([Parameter('seed', 1, 'A seed.')])
"""


def test_a_parameter_may_have_any_name_but_seed(repository, tmp_path):
    """Each tracker has a seed of its own: before, such a one was offered, and couldn't be made."""
    (tmp_path / 'named.py').write_text(NAMED)
    register(tmp_path, 'named', ['named = named:Named', 'seeded = named:Seeded'])
    done = subprocess.run(
        [sys.executable, '-c', 'from vtrack_ros.trackers import create_tracker, tracker_names\n'
         'assert create_tracker("named", seed=0, name="a").parameters["name"] == "a"\n'
         'assert "seeded" not in tracker_names()'],
        capture_output=True, text=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join((str(repository), str(tmp_path)))})
    assert done.returncode == 0, done.stderr
    assert "tracker 'seeded' of named:Seeded is ignored" in done.stderr
    assert "must not have a parameter 'seed'" in done.stderr


def test_of_two_packages_with_one_name_a_single_one_is_used(site, repository, tmp_path):
    """The other one is warned of, whichever is found first; before, the last one was used."""
    (tmp_path / 'second.py').write_text(
        'from steady_tracker import SteadyTracker\nclass Second(SteadyTracker): pass\n')
    register(tmp_path, 'second', ['steady = second:Second'])
    for folders, used, left in (
            ((site, tmp_path), 'SteadyTracker', 'second:Second'),
            ((tmp_path, site), 'Second', 'steady_tracker:SteadyTracker')):
        done = subprocess.run(
            [sys.executable, '-c', 'from vtrack_ros.trackers import tracker_class, tracker_names\n'
             'print(tracker_class("steady").__name__, tracker_names().count("steady"))'],
            capture_output=True, text=True,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join(map(str, (repository, *folders)))})
        assert done.stdout.split() == [used, '1'], done.stderr
        [line] = [line for line in done.stderr.splitlines() if "tracker 'steady'" in line]
        assert left in line and 'another package' in line


def test_node_and_page(site):
    """The node tracks with it; the page of vtrack select offers it, and sets its parameters."""
    scene = Scene()
    prelude = f'sys.path.append({str(site)!r})'
    with NodeProcess(prelude=prelude, tracker='steady') as node, Client().ready() as client:
        assert client.change(init_box=list(map(float, scene.box(0).as_array())))[0].successful
        assert overlap(client.play(scene, range(10))[-1], scene.box(9)) > 0.6
        assert client.change(steady__share=0.9)[0].successful
        [refused] = client.change(steady__share=2.0)
        assert 'from 0.1 to 1' in refused.reason

        async def choose(address):
            async with viewer(address) as seen:
                rows = {row['name']: row for row in (await seen.receive('parameters'))['rows']}
                assert 'steady' in rows['tracker']['choices']
                share = rows['steady.share']
                assert (share['value'], share['low'], share['high']) == (0.9, 0.1, 1.0)
                await seen.ask(do='set', name='steady.share', kind='float', value=0.5)
                await seen.told('steady.share is 0.5')
                await seen.ask(do='set', name='tracker', kind='text', value='dcf')
                await seen.told('tracker is dcf')
                await seen.ask(do='set', name='tracker', kind='text', value='steady')
                await seen.told('tracker is steady')
        with serving() as address:
            asyncio.run(choose(address))
        assert "tracker 'broken' of no_such_module:Tracker is ignored" in node.log
