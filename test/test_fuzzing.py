"""The fuzzer's seeds and past findings: refused with a ValueError, or read correctly."""

from pathlib import Path

import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from fuzzing.targets import refused_or_right, TARGETS  # noqa: E402, I100

FOLDER = Path(__file__).with_name('fuzzing')
FILES = sorted(path for path in FOLDER.rglob('*') if path.is_file())


def test_every_target_has_seeds():
    """Each target has a folder of its name with seeds."""
    assert {path.parent.name for path in FILES} == set(TARGETS)


@pytest.mark.parametrize('path', FILES, ids=lambda path: f'{path.parent.name}-{path.name}')
def test_input(path):
    """Whole, and cut off or with a byte changed at each eighth, it's refused or read correctly."""
    data = path.read_bytes()
    refused_or_right(path.parent.name, data)
    for length in range(0, len(data), max(1, len(data) // 8)):
        refused_or_right(path.parent.name, data[:length])
        changed = bytes([data[length] ^ 0x55])
        refused_or_right(path.parent.name, data[:length] + changed + data[length + 1:])
