"""One thread for everything, so that times can be compared."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

import cv2

try:
    from threadpoolctl import threadpool_limits
except ImportError:
    # Worker processes are started with one thread; only runs in this one may then use more.
    threadpool_limits = nullcontext


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep OpenCV and the linear algebra on one thread meanwhile."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        cv2.setNumThreads(threads)
