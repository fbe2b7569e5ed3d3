"""
Fuzzing of all that reads other people's data: converters, bags, parameters, state files.

`PYTHON benchmarks/fuzz.py TARGET... [--runs N]` needs atheris (`pip install atheris`), which looks
for inputs that reach new branches of the package. It starts from the inputs in test/fuzzing/, adds
new ones to `--corpus`, and ends at the first failure, whose input it writes to crash-*. The tests
run the inputs in test/fuzzing/ without atheris.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import subprocess
import sys
import time

ROOT = Path(__file__).resolve().parents[1]
#: Inputs that are kept: small valid ones, and those that once caused a failure.
SEEDS = ROOT / 'test' / 'fuzzing'


def main() -> int:
    """Fuzz one target after the other, each in a process of its own; return the exit code."""
    if sys.argv[1:2] == ['--one']:
        _fuzz(*sys.argv[2:])
        return 0
    names = sorted(folder.name for folder in SEEDS.iterdir() if folder.is_dir())
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('targets', nargs='*', default=names, metavar='TARGET',
                        help='of ' + ', '.join(names) + ' (default: all)')
    parser.add_argument('--runs', type=int, default=100_000, help='of each (default: %(default)s)')
    parser.add_argument('--corpus', type=Path, default=Path('/tmp/vtrack-fuzzing'), metavar='DIR',
                        help='where inputs that reach something new are kept '
                        '(default: %(default)s)')
    arguments = parser.parse_args()
    for name in arguments.targets:
        began = time.time()
        folder = arguments.corpus / name
        folder.mkdir(parents=True, exist_ok=True)
        code = subprocess.run([sys.executable, __file__, '--one', name, str(folder),
                               str(SEEDS / name), f'-runs={arguments.runs}']).returncode
        print(f'{name}: {arguments.runs} runs, exit code {code}, {time.time() - began:.0f} s',
              flush=True)
        if code:
            return 1
    return 0


def _fuzz(name: str, *options: str) -> None:
    import atheris
    with atheris.instrument_imports(include=['vtrack_ros', 'rosbags']):
        from fuzzing.targets import refused_or_right
    atheris.Setup([sys.argv[0], *options, '-max_len=4096', '-timeout=20', '-rss_limit_mb=2048',
                   '-print_final_stats=1', '-verbosity=0'],
                  lambda data: refused_or_right(name, data))
    atheris.Fuzz()


if __name__ == '__main__':
    sys.exit(main())
