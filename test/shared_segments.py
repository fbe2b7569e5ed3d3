"""Shared-memory segments of Fast DDS by process, for tests of what is left of them."""

from collections.abc import Iterable
from pathlib import Path
import subprocess

from vtrack_ros.dds import give_memory_back


def segments(processes: Iterable[int]) -> set[Path]:
    """Return the segments that processes have mapped, except those of the ports."""
    found = set()
    for process in processes:
        for line in Path(f'/proc/{process}/maps').read_text().splitlines():
            path = Path(line.split()[-1])
            if path.name.startswith('fastrtps_') and 'port' not in path.name:
                found.add(path)
    return found


def group(leader: int) -> list[int]:
    """Return the processes of a group."""
    found = []
    for stat in Path('/proc').glob('[0-9]*/stat'):
        try:
            # the name, in brackets, may hold anything
            fields = stat.read_text().rsplit(')', 1)[1].split()
        except OSError:
            # it has ended since
            continue
        if int(fields[2]) == leader:
            found.append(int(stat.parent.name))
    return found


def kill(process: subprocess.Popen[str] | subprocess.Popen[bytes]) -> None:
    """Kill a process, if it hasn't ended, without leaving its shared memory behind."""
    if process.poll() is None:
        give_memory_back(process.pid)
    process.kill()
    process.wait()
