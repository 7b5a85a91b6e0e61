"""Ranges of independent problems on a few threads of one process."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ..errors import InvalidValueError, shown

MOST_THREADS = 1024
Job = Callable[[int, int, int], object]  # (worker, first, end)


class RangeThreads:
    """Splits 0..n-1 into one range for each thread, of which the calling thread is the first.

    Worth it for compiled jobs that release the interpreter lock. The threads start at first use and anew in a
    forked process, which has none of its parent's.
    """

    def __init__(self, threads: int = 1):
        """Start nothing yet.

        Raises:
            InvalidValueError: for less than one thread or more than MOST_THREADS.
        """
        if isinstance(threads, bool) or not isinstance(threads, int) or not 1 <= threads <= MOST_THREADS:
            raise InvalidValueError(
                f"threads must be a whole number from 1 to {MOST_THREADS}, got {shown(threads)}"
            )
        self.threads = threads
        self._pool: ThreadPoolExecutor | None = None
        self._process = 0

    def __reduce__(self) -> tuple[Any, ...]:
        return RangeThreads, (self.threads,)

    def run(self, job: Job, n: int, least: int = 1) -> None:
        """Call job(worker, first, end) for ranges that cover 0..n-1, and wait for all of them.

        No two calls of one `run` have the same worker, 0..threads-1.

        Args:
            job: what to do.
            n: number of problems.
            least: the smallest range worth a thread of its own.
        """
        count = min(self.threads, n // least)
        if count <= 1:
            job(0, 0, n)
            return
        pool = self._started()
        others = [pool.submit(job, w, n * w // count, n * (w + 1) // count) for w in range(1, count)]
        try:
            job(0, 0, n // count)
        finally:
            errors = [other.exception() for other in others]
        for error in errors:
            if error is not None:
                raise error

    def _started(self) -> ThreadPoolExecutor:
        if self._pool is None or self._process != os.getpid():
            self._pool = ThreadPoolExecutor(self.threads - 1, thread_name_prefix="robots")
            self._process = os.getpid()
        return self._pool
