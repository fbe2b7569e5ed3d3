"""One thread for everything, so that times can be compared."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
import sys

import cv2

#: What keeps the linear algebra of a process that is started with it on one thread.
ONE_THREAD = dict.fromkeys((
    'OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'BLIS_NUM_THREADS',
    'VECLIB_MAXIMUM_THREADS', 'NUMEXPR_NUM_THREADS'), '1')


@contextmanager
def environment_variables(values: dict[str, str]) -> Iterator[None]:
    """Set variables for the processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def opencv_on_one_thread() -> Iterator[None]:
    """Keep OpenCV on one thread meanwhile."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def restart_on_one_thread() -> None:
    """
    Keep a script on one thread: start it anew where its environment allows more.

    The linear algebra reads its environment when it's first imported, which is long ago here.
    """
    if any(os.environ.get(name) != value for name, value in ONE_THREAD.items()):
        os.environ.update(ONE_THREAD)
        sys.stdout.flush()
        os.execv(sys.executable, [sys.executable, *sys.argv])
    cv2.setNumThreads(1)
