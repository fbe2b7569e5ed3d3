"""The package's dependencies: consistent, free to use, and without known vulnerabilities."""

from __future__ import annotations

from importlib.metadata import distribution, PackageNotFoundError
import json
from pathlib import Path
import re
import subprocess
import sys

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
import pytest

pytest.importorskip('pip_audit', reason='needs pip-audit')

pytestmark = pytest.mark.lint

#: What a user installs: the library, the tools, the page, and ROS from PyPI.
FILES = ('run.txt', 'tools.txt', 'select.txt', 'ros.txt')
#: Words in the licences of packages that one under Apache-2.0 may use.
FREE = re.compile(r'any-osi|apache|bsd|hpnd|isc\b|mit\b|mozilla|mpl|psf|python software|'
                  r'unlicense|zlib|permission is hereby granted', re.IGNORECASE)
#: Wheels that don't state a licence: eProsima's, under Apache-2.0, and metapackages.
SILENT = re.compile('ros-fastcdr|ros-fastrtps|ros-jazzy-.*')
#: A release with known vulnerabilities (CVE-2024-22195 and others), to test the database.
KNOWN = 'jinja2==3.1.2'


@pytest.fixture(scope='module')
def installed(repository: Path) -> dict[str, str]:
    """Return name -> version of all dependencies of the package, direct and indirect."""
    waiting = [Requirement(line) for name in FILES
               for line in (repository / 'requirements' / name).read_text().splitlines()
               if line and not line.startswith('#')]
    found: dict[str, str] = {}
    while waiting:
        wanted = waiting.pop()
        if wanted.marker is not None and not wanted.marker.evaluate({'extra': ''}):
            continue
        name = canonicalize_name(wanted.name)
        try:
            one = distribution(name)
        except PackageNotFoundError:
            pytest.fail(f'{name} is needed, but not installed')
        assert wanted.specifier.contains(one.version, prereleases=True), (
            f'{wanted} is needed, but {one.version} installed')
        if name not in found:
            found[name] = one.version
            waiting.extend(map(Requirement, one.requires or ()))
    return found


def test_licences_are_compatible(installed: dict[str, str]) -> None:
    """All may be used and passed on with a package under Apache-2.0."""
    licences = {name: licence(name) for name in installed if not SILENT.fullmatch(name)}
    assert {name: text for name, text in licences.items() if not FREE.search(text)} == {}


def licence(name: str) -> str:
    """Return what a distribution states of its licence, in its metadata or in its files."""
    one = distribution(name)
    said = one.metadata
    texts = [said.get('License-Expression', ''), (said.get('License') or '')[:200],
             *(text for text in said.get_all('Classifier', ()) if 'License' in text)]
    for file in one.files or ():
        if file.name == 'package.xml':
            texts += re.findall(r'<license[^>]*>([^<]*)', file.read_text())
        elif file.name == 'LICENSE':
            texts.append(file.read_text()[:200])
    return ' '.join(texts).strip()


def test_no_known_vulnerability(installed: dict[str, str], tmp_path: Path) -> None:
    """The Python Packaging Advisory Database has no vulnerability of what is installed."""
    if not audited([KNOWN], tmp_path):
        pytest.skip('the database of advisories cannot be reached, or is not whole')
    holes = audited([f'{name}=={version}' for name, version in installed.items()], tmp_path)
    assert not holes


def audited(pinned: list[str], folder: Path) -> list[str]:
    """Return the vulnerabilities that pip-audit finds in pinned releases."""
    path = folder / 'pinned.txt'
    path.write_text('\n'.join(pinned) + '\n')
    run = subprocess.run(
        [sys.executable, '-m', 'pip_audit', '--requirement', path, '--no-deps', '--disable-pip',
         '--format', 'json', '--progress-spinner', 'off', '--timeout', '5',
         '--cache-dir', folder / 'cache'],
        capture_output=True, text=True)
    try:
        rows = json.loads(run.stdout)['dependencies']
    except ValueError:
        return []
    return [f'{row["name"]} {row["version"]}: {hole["id"]}, fixed in {hole["fix_versions"]}'
            for row in rows for hole in row.get('vulns', ())]
