"""The package as people install it: colcon and the ament index, pip, the executables."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import metadata
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import time
from xml.etree import ElementTree

import pytest
from shared_segments import kill

EXECUTABLES = ('tracker', 'tracker_lifecycle', 'vtrack')
#: Time-out for discovery, for an answer and for the end of a process, in seconds.
PATIENCE = 30.0


def clean_environment(**changes: str) -> dict[str, str]:
    """Return the environment of a fresh shell, without what the ROS wheels left in this one."""
    left = ('_ROS_WHEELS_BOOTSTRAP_COMPLETE', 'LD_LIBRARY_PATH', 'PYTHONPATH')
    environment = {name: value for name, value in os.environ.items() if name not in left}
    path = f'{Path(sys.executable).parent}:{environment["PATH"]}'
    return {**environment, 'PATH': path, **changes}


def run(*command: str | Path, cwd: Path, **changes: str) -> str:
    """Run a command to its end and return its output; it must succeed."""
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, env=clean_environment(**changes), text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stdout
    return done.stdout


def copy_sources(repository: Path, target: Path) -> None:
    """Copy the source tree without what is built, installed or hidden in it."""
    shutil.copytree(repository, target, ignore=shutil.ignore_patterns(
        '.*', '__pycache__', '*.egg-info', 'build', 'install', 'log', '*-output'))


def test_manifest(repository: Path) -> None:
    """The manifest has what colcon and bloom demand."""
    root = ElementTree.parse(repository / 'package.xml').getroot()
    assert (root.get('format'), root.findtext('name')) == ('3', 'vtrack_ros')
    assert root.findtext('license') == 'Apache-2.0'
    assert root.findtext('export/build_type') == 'ament_python'
    # With an invalid address colcon takes the package for plain Python, without a word.
    assert re.fullmatch(r'[\w.+-]+@[\w-]+(\.[\w-]+)+', root.find('maintainer').get('email'))
    assert re.fullmatch(r'\d+\.\d+\.\d+', root.findtext('version'))
    changes = (repository / 'CHANGELOG.rst').read_text()
    assert re.search(rf'^({root.findtext("version")} \(.*\)|Forthcoming)$', changes, re.MULTILINE)


def test_pip(repository: Path, tmp_path: Path) -> None:
    """Plain pip installs executables, data and requirements; the version is the manifest's."""
    # Asked without an import: setuptools would put its own distutils into this process.
    for name, least in (('pip', 23), ('setuptools', 71)):
        versions = [found.version for found in metadata.distributions(name=name)]
        if not versions or int(versions[0].split('.')[0]) < least:
            pytest.skip(f'needs {name} {least}')
    copy_sources(repository, tmp_path / 'vtrack_ros')
    prefix = tmp_path / 'prefix'
    run(sys.executable, '-m', 'pip', '--disable-pip-version-check', '--no-input', '-q', 'install',
        '--prefix', prefix, '--ignore-installed', '--no-deps', '--no-build-isolation',
        '--no-compile', '--no-index', tmp_path / 'vtrack_ros', cwd=tmp_path)
    for name in EXECUTABLES:
        assert os.access(prefix / 'bin' / name, os.X_OK)
    share = prefix / 'share'
    assert (share / 'ament_index' / 'resource_index' / 'packages' / 'vtrack_ros').is_file()
    [library] = prefix.glob('lib/python*/site-packages')
    script = ('from vtrack_ros import __version__; print(__version__)\n'
              'from vtrack_ros.dds import profile_path; print(profile_path())')
    version, profile = run(sys.executable, '-c', script, cwd=tmp_path,
                           PYTHONPATH=str(library)).splitlines()
    assert version == ElementTree.parse(repository / 'package.xml').findtext('version')
    assert Path(profile) == share / 'vtrack_ros' / 'config' / 'fastdds.xml'
    [found] = metadata.distributions(name='vtrack_ros', path=[str(library)])
    needed = {re.match(r'[\w-]+', each)[0] for each in found.requires if 'extra ==' not in each}
    assert needed == {'numpy', 'opencv-python-headless', 'scipy'}
    extras = {'lint', 'ros', 'select', 'test', 'tools'}
    assert set(found.metadata.get_all('Provides-Extra')) == extras


def test_sources_that_are_not_installed_have_the_version_of_the_manifest(repository: Path,
                                                                         tmp_path: Path) -> None:
    """Sources used uninstalled (beside other trackers) have it; without manifest: 'unknown'."""
    script = 'from vtrack_ros import __version__; print(__version__)'
    # -S leaves out site-packages, as if nothing were installed.
    assert run(sys.executable, '-S', '-c', script, cwd=repository).strip() == (
        ElementTree.parse(repository / 'package.xml').findtext('version'))
    shutil.copytree(repository / 'vtrack_ros', tmp_path / 'vtrack_ros')
    assert run(sys.executable, '-S', '-c', script, cwd=tmp_path).strip() == 'unknown'


def test_tests_without_what_rosdep_leaves_out(repository: Path, tmp_path: Path) -> None:
    """Where rosbags or onnx is missing, the tests that need it are skipped, and colcon's pass."""
    (tmp_path / 'without.py').write_text(
        'from importlib.machinery import PathFinder\n'
        'found = PathFinder.find_spec\n'
        'PathFinder.find_spec = lambda name, *where: (\n'
        '    None if name in ("onnx", "rosbags") else found(name, *where))\n')
    output = run(sys.executable, '-m', 'pytest', '-p', 'without', '-rs', '-k', 'positive_series',
                 '--no-header', 'test/test_demo.py', 'test/test_trackers_opencv.py',
                 'test/test_estimation_grey.py', cwd=repository,
                 PYTHONPATH=os.pathsep.join((str(repository), str(tmp_path))))
    assert 'needs rosbags' in output and 'needs onnx' in output


@pytest.fixture(scope='module')
def workspace(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a workspace with the built package."""
    if shutil.which('colcon', path=clean_environment()['PATH']) is None:
        pytest.skip('needs colcon')
    root = tmp_path_factory.mktemp('workspace')
    copy_sources(repository, root / 'src' / 'vtrack_ros')
    underlay = os.pathsep.join(filter(None, (os.environ.get('AMENT_PREFIX_PATH'), sys.prefix)))
    output = run('colcon', 'build', cwd=root, AMENT_PREFIX_PATH=underlay)
    assert '1 package finished' in output
    return root


def sourced(workspace: Path, command: str) -> list[str]:
    """Return a shell command in which the workspace is sourced."""
    return ['bash', '-c', f'source "{workspace}/install/setup.bash" && {command}']


@pytest.mark.colcon
def test_layout(workspace: Path) -> None:
    """Everything is where ros2 run, ros2 launch and the ament index look for it."""
    prefix = workspace / 'install' / 'vtrack_ros'
    for name in EXECUTABLES:
        assert os.access(prefix / 'lib' / 'vtrack_ros' / name, os.X_OK)
    share = prefix / 'share' / 'vtrack_ros'
    assert (share / 'package.xml').is_file()
    for folder in ('config', 'launch'):
        sources = workspace / 'src' / 'vtrack_ros' / folder
        wanted = {path.name for path in sources.iterdir()} if sources.is_dir() else set()
        assert {path.name for path in (share / folder).iterdir()} == wanted
    assert (share / 'config' / 'fastdds.xml').is_file()


@pytest.mark.colcon
def test_ament_index(workspace: Path) -> None:
    """The index knows the package, and Python imports the installed one."""
    pytest.importorskip('ament_index_python', reason='needs ament_index_python')
    script = ('from ament_index_python.packages import get_package_prefix as prefix\n'
              'import vtrack_ros\n'
              'print(prefix("vtrack_ros"), vtrack_ros.__file__)')
    output = run(*sourced(workspace, f"exec '{sys.executable}' -c '{script}'"), cwd=workspace)
    prefix, module = map(Path, output.split())
    assert prefix == workspace / 'install' / 'vtrack_ros'
    assert prefix in module.parents


@pytest.mark.colcon
def test_command_line(workspace: Path) -> None:
    """The installed command line answers."""
    executable = workspace / 'install' / 'vtrack_ros' / 'lib' / 'vtrack_ros' / 'vtrack'
    output = run(*sourced(workspace, f'exec {executable} --help'), cwd=workspace)
    assert output.startswith('usage: vtrack')


@pytest.mark.colcon
def test_colcon_test(workspace: Path) -> None:
    """Colcon finds the tests, and runs them with pytest."""
    run('colcon', 'test', '--return-code-on-test-failure', '--pytest-args', '-k', 'test_manifest',
        'test/test_package.py', cwd=workspace, AMENT_PREFIX_PATH=sys.prefix)
    output = run('colcon', 'test-result', '--all', cwd=workspace)
    assert re.search(r'Summary: 1 tests?, 0 errors, 0 failures, 0 skipped', output), output


@pytest.fixture
def tracker(workspace: Path) -> Iterator[subprocess.Popen[str]]:
    """Run the installed node in a process of its own."""
    executable = workspace / 'install' / 'vtrack_ros' / 'lib' / 'vtrack_ros' / 'tracker'
    process = subprocess.Popen(
        sourced(workspace, f'exec {executable} --ros-args -p seed:=3'), cwd=workspace,
        env=clean_environment(), text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    yield process
    kill(process)


@pytest.mark.colcon
def test_node(tracker: subprocess.Popen[str]) -> None:
    """The installed node answers parameter calls of this process, and ends cleanly."""
    rclpy = pytest.importorskip('rclpy', reason='needs rclpy')
    from rclpy.parameter import Parameter
    from rclpy.parameter_client import AsyncParameterClient

    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('test_package', context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    client = AsyncParameterClient(node, '/tracker')

    def answer(future):
        executor.spin_until_future_complete(future, PATIENCE)
        assert future.done(), 'no answer'
        return future.result()

    try:
        deadline = time.monotonic() + PATIENCE
        while not client.wait_for_services(0.5):
            assert tracker.poll() is None, tracker.communicate()[0]
            assert time.monotonic() < deadline, 'the node never appeared'
        values = answer(client.get_parameters(['seed'])).values
        assert [value.integer_value for value in values] == [3]
        results = answer(client.set_parameters([Parameter('gmpf.particles', value=80)])).results
        assert [result.successful for result in results] == [True]
        values = answer(client.get_parameters(['gmpf.particles'])).values
        assert [value.integer_value for value in values] == [80]
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
    tracker.send_signal(signal.SIGINT)
    output, _ = tracker.communicate(timeout=PATIENCE)
    assert tracker.returncode == 0, output
    assert 'Traceback' not in output
