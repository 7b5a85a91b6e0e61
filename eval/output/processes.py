"""Worker processes of this machine, and an end at Ctrl-C that loses nothing.

Ctrl-C at any moment, any number of times: a command ends within seconds, with one line and code 130.

Worker processes: one state each, one task at a time, and an end with the process that started them.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import FrameType, TracebackType
from typing import Any, Generic, Self, TypeVar

from ...controllers.errors import PushRecoveryError

GRACE = 2.0  # that a command has to come to its own end [s]
INTERRUPTED = 130  # exit code
STOPPED = "push-recovery: error: interrupted; what was done is kept"
SHOW_CURSOR = "\r\x1b[?25h"  # a progress bar hides it


def end_now(*_: object) -> None:
    """Say so and end this process; its workers end with it, and all that was finished is on disk."""
    with suppress(OSError):
        text = f"{SHOW_CURSOR if os.isatty(2) else ''}{STOPPED}\n"
        os.write(2, text.encode())
    os._exit(INTERRUPTED)


def end_at_ctrl_c() -> None:
    """End at the first Ctrl-C, as long as there is nothing to clear away; where it is ignored, ignore it."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, end_now)


class CtrlC:
    """Within the block the first Ctrl-C raises KeyboardInterrupt, and the others do nothing.

    The process ends where the block has not ended GRACE after the first one, as in compiled code that does
    not look up, and where the exception is raised in a place that can't pass it on, such as `__del__`. Only
    the main thread may say so; in another one, and where Ctrl-C is ignored, nothing changes.

    Args:
        last: nothing but the end of the process follows: GRACE counts until then, and Ctrl-C stays without
            effect.
    """

    def __init__(self, last: bool = False):
        self.came = False
        self._last = last
        self._before: Any = signal.SIG_IGN
        self._over = threading.Event()

    def __enter__(self) -> CtrlC:
        if threading.current_thread() is not threading.main_thread():
            return self
        self._before = signal.getsignal(signal.SIGINT)
        if self._before not in (signal.SIG_IGN, None):
            reader, self._pipe = os.pipe()
            os.set_blocking(self._pipe, False)
            # the number of a signal comes through it at once, the handler's turn when compiled code returns
            self._pipe_before = signal.set_wakeup_fd(self._pipe, warn_on_full_buffer=False)
            threading.Thread(target=self._watch, args=(reader,), daemon=True).start()
            self._hook_before, sys.unraisablehook = sys.unraisablehook, self._unraisable
            signal.signal(signal.SIGINT, self._raise)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._before in (signal.SIG_IGN, None):
            return
        signal.signal(signal.SIGINT, signal.SIG_IGN if self._last else self._before)
        if not self._last:
            sys.unraisablehook = self._hook_before
            self._over.set()
            signal.set_wakeup_fd(self._pipe_before)
            os.close(self._pipe)

    def _raise(self, number: int, frame: FrameType | None) -> None:
        if not self.came:
            self.came = True
            raise KeyboardInterrupt

    def _watch(self, reader: int) -> None:
        """End the process GRACE after the first Ctrl-C, unless the block is over by then."""
        while number := os.read(reader, 1):
            if number[0] == signal.SIGINT and not self._over.wait(GRACE):
                end_now()
        os.close(reader)

    def _unraisable(self, lost: Any) -> None:
        if lost.exc_type is KeyboardInterrupt:
            end_now()
        self._hook_before(lost)


@contextmanager
def ctrl_c_held_back() -> Iterator[None]:
    """Keep Ctrl-C back until the end of the block; a process that is started in it is born deaf to it.

    In another thread than the main one only the latter holds.
    """
    came: list[int] = []
    main = threading.current_thread() is threading.main_thread()
    before: Any = signal.signal(signal.SIGINT, lambda number, frame: came.append(number)) if main else None
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # children inherit it
    try:
        yield
    finally:
        if main:
            signal.signal(signal.SIGINT, before or signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if came:
            signal.raise_signal(signal.SIGINT)


S = TypeVar("S")
J = TypeVar("J")
R = TypeVar("R")
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
LEAVING = 1.0  # that a worker without a job has to end by itself [s]


class WorkerError(PushRecoveryError):
    """A task raised in a worker process, whose words the message has, or the process ended."""


@dataclass(frozen=True)
class _Worker:
    """A process, and this end of the pipe between it and us."""

    process: BaseProcess
    connection: Connection


class Pool(ABC, Generic[S]):
    """Workers that do jobs; a context manager, at whose end nothing that was not done goes on."""

    @abstractmethod
    def run(self, task: Callable[[S, J], R], jobs: Sequence[J]) -> Iterator[tuple[int, R]]:
        """Number and result of every job, as they finish."""

    @abstractmethod
    def close(self) -> None:
        """End what is not done."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class WorkerPool(Pool[S]):
    """Spawned processes of one thread each; a context manager, at whose end none of them is left.

    Where this process ends in any other way, by a kill too, they end by themselves. Ctrl-C is for this
    process to decide on.

    Args:
        workers: how many.
        start: makes the state of a worker, in the worker; what it raises is told in the place of a result.
        arguments: of `start`; picklable.
    """

    def __init__(self, workers: int, start: Callable[..., S], *arguments: Any):
        for name in THREAD_VARIABLES:  # read by the children's libraries
            os.environ.setdefault(name, "1")
        self._workers: list[_Worker] = []
        self._busy: dict[Connection, int] = {}  # number of the job
        resource_tracker.ensure_running()  # whose start would make workers hear Ctrl-C again
        try:
            with ctrl_c_held_back():  # no worker is half started, and none ever hears of it
                for _ in range(workers):
                    self._workers.append(_started(start, arguments))
        except BaseException:
            self.close()
            raise

    def run(self, task: Callable[[S, J], R], jobs: Iterable[J]) -> Iterator[tuple[int, R]]:
        """Number and result of every job, as they finish; a worker has one job at a time.

        Args:
            task: module-level function of a worker's state and a job.
            jobs: picklable.

        Raises:
            WorkerError: a task raised, or a worker ended. The pool is of no further use then.
        """
        queue = enumerate(jobs)
        for worker in self._workers:
            self._give_next(queue, worker.connection, task)
        while self._busy:
            for connection in wait(list(self._busy)):
                assert isinstance(connection, Connection)  # noqa: S101
                result = _received(connection)
                number = self._busy.pop(connection)
                self._give_next(queue, connection, task)
                yield number, result

    def _give_next(self, queue: Iterator[tuple[int, Any]], connection: Connection, task: Any) -> None:
        for number, job in islice(queue, 1):
            self._busy[connection] = number
            _send(connection, (task, job))

    def close(self) -> None:
        """End the processes: those at work at once, the others by themselves if they are quick."""
        for worker in self._workers:
            if worker.connection in self._busy:
                worker.process.kill()
            worker.connection.close()
        for worker in self._workers:
            worker.process.join(LEAVING)
            worker.process.kill()
            worker.process.join()
        self._workers, self._busy = [], {}


def _started(start: Callable[..., Any], arguments: tuple[Any, ...]) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs,), daemon=True)
    process.start()
    theirs.close()  # so that ours tells when the process ends
    worker = _Worker(process, ours)
    _send(ours, (start, arguments))
    return worker


def _send(connection: Connection, content: Any) -> None:
    with suppress(BrokenPipeError, ConnectionResetError):  # the worker has ended, which `_received` tells
        connection.send(content)


def _received(connection: Connection) -> Any:
    """The result of a worker's job.

    Raises:
        WorkerError: the task raised, or the process ended.
    """
    try:
        result, error = connection.recv()
    except (EOFError, ConnectionResetError) as ended:
        raise WorkerError(
            "a worker process ended before its work was done; with one the error shows where it happens"
        ) from ended
    if error is not None:
        raise WorkerError(error)
    return result


def _work(connection: Connection) -> None:
    """What a worker does: make its state, then one task after the other until nobody asks for more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # not to be handed on to what a policy starts
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # nobody asks any more
        state, failed = _made(connection.recv_bytes())
        while True:
            message = connection.recv_bytes()
            connection.send_bytes(failed or _answer(state, message))


def _made(message: bytes) -> tuple[Any, bytes | None]:
    """The state of a worker, or what to answer to every job where it can't be made."""
    try:
        start, arguments = pickle.loads(message)  # noqa: S301  # of the process that started this one
        return start(*arguments), None
    except Exception as error:
        return None, _failure(error)


def _answer(state: Any, message: bytes) -> bytes:
    """The result of a task and no error, or none and an error's words."""
    try:
        task, job = pickle.loads(message)  # noqa: S301
        return pickle.dumps((task(state, job), None))
    except Exception as error:
        return _failure(error)


def _failure(error: Exception) -> bytes:
    """Errors travel as text, since not every exception survives pickling."""
    return pickle.dumps((None, f"{type(error).__name__}: {error}"))


def _end_with_parent() -> None:
    """Wait for the end of the process that has started this one, and end at once."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
