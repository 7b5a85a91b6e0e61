"""Worker processes with a state each: spawned on this machine, or those of a Ray cluster of many.

Both kinds of pool do the same jobs with the same results, end with the process that asks for them, and turn
whatever goes wrong in a worker into one `WorkerError`.
"""

import multiprocessing
import os
import pickle
import signal
import socket
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, as_completed
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from multiprocessing.connection import Connection
from typing import Any, Generic, Self, TypeVar

from ...controllers.errors import InvalidValueError, MissingExtraError, PushRecoveryError
from .interrupt import ctrl_c_held_back

S = TypeVar("S")
J = TypeVar("J")
R = TypeVar("R")
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
LEAVING = 1.0  # that a worker without a job has to end by itself [s]
LOCAL = "local"  # address of a cluster of this machine alone, which ends with this process
CLIENT = "ray://"  # before the address of a cluster that this machine is no part of
STORE = 80 * 2**20  # memory for what workers are handed, where the cluster is this process's own [B]
ANSWER = 5.0  # that an address has to answer [s]
STARTS = 3  # of a cluster of this machine that are tried
RETRIES = 3  # of a job whose Ray worker has ended
_STATE: dict[str, tuple[Any, bytes | None]] = {}  # of this worker: `_made` by the name of its pool


def _one_thread_each() -> None:
    for name in THREAD_VARIABLES:  # which processes that are started from here inherit
        os.environ.setdefault(name, "1")


class WorkerError(PushRecoveryError):
    """A task raised in a worker process, whose words the message has, or the process ended."""


class Pool(ABC, Generic[S]):
    """Workers that do jobs; a context manager, at whose end nothing that was not done goes on."""

    def __init__(self) -> None:
        self._pending: dict[Future[bytes], int] = {}  # number of the job

    def run(self, task: Callable[[S, J], R], jobs: Iterable[J]) -> Iterator[tuple[int, R]]:
        """Number and result of every job, as they finish; a worker has one job at a time.

        Args:
            task: module-level function of a worker's state and a job.
            jobs: picklable.

        Raises:
            WorkerError: a task raised, or a worker ended. The pool is of no further use then.
        """
        try:
            with ctrl_c_held_back():  # no worker is half started, and none ever hears of it
                for number, job in enumerate(jobs):
                    self._pending[self._submit(task, job)] = number
        except BrokenExecutor as lost:
            raise WorkerError(self._ended(lost)) from lost
        for future in as_completed(tuple(self._pending)):
            try:
                result, error = pickle.loads(future.result())  # noqa: S301  # of our own worker
            except Exception as lost:
                raise WorkerError(self._ended(lost)) from lost
            number = self._pending.pop(future)
            if error is not None:
                raise WorkerError(error)
            yield number, result

    @abstractmethod
    def _submit(self, task: Callable[[S, Any], Any], job: Any) -> Future[bytes]:
        """The `_answer` to a job."""

    @abstractmethod
    def _ended(self, error: Exception) -> str:
        """Words for a worker that ended before its job was done."""

    @abstractmethod
    def close(self) -> None:
        """End what is not done."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class WorkerPool(Pool[S]):
    """Spawned processes of one thread each; a context manager, at whose end none of them is left.

    Each holds one end of a pipe that nothing is ever sent through. Its other end closes with this process,
    by a kill too, and with the pool: the workers end then, whatever they are at. Ctrl-C is for this process
    to decide on.

    Args:
        workers: how many.
        start: makes the state of a worker, in the worker; where it raises, every job does.
        arguments: of `start`; picklable.
    """

    def __init__(self, workers: int, start: Callable[..., S], *arguments: Any):
        super().__init__()
        _one_thread_each()
        context = multiprocessing.get_context("spawn")
        theirs, self._lifeline = context.Pipe(duplex=False)
        begin = theirs, pickle.dumps((start, arguments))
        self._executor = ProcessPoolExecutor(workers, context, _begin, begin)

    def _submit(self, task: Callable[[S, Any], Any], job: Any) -> Future[bytes]:
        return self._executor.submit(_perform, pickle.dumps((task, job)))

    def _ended(self, error: Exception) -> str:
        if isinstance(error, BrokenExecutor):
            return (
                "a worker process ended before its work was done; with one the error shows where it happens"
            )
        return f"{type(error).__name__}: {error}"

    def close(self) -> None:
        """End the processes: those at work at once, the others by themselves if they are quick."""
        if self._pending:
            self._lifeline.close()
        late = threading.Timer(LEAVING, self._lifeline.close)
        late.start()
        self._executor.shutdown(cancel_futures=True)
        late.cancel()
        self._lifeline.close()
        self._pending = {}


def _begin(lifeline: Connection, made: bytes) -> None:
    """Make the state of a spawned process, which ends when the other end of its lifeline is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # not to be handed on to what a policy starts
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()
    _STATE[LOCAL] = _made(made)


def _end_with(lifeline: Connection) -> None:
    with suppress(EOFError, OSError):
        lifeline.recv_bytes()
    os._exit(1)


def _perform(job: bytes) -> bytes:
    return _answer(*_STATE[LOCAL], job)


def _made(content: bytes) -> tuple[Any, bytes | None]:
    """The state of a worker, or what to answer to every job where it can't be made."""
    try:
        start, arguments = pickle.loads(content)  # noqa: S301  # of the process that started this one
        return start(*arguments), None
    except Exception as error:
        return None, _failure(error)


def _answer(state: Any, failed: bytes | None, content: bytes) -> bytes:
    """The result of a task and no error, or none and an error's words; pickled."""
    if failed is not None:
        return failed
    try:
        task, job = pickle.loads(content)  # noqa: S301
        return pickle.dumps((task(state, job), None))
    except Exception as error:
        return _failure(error)


def _failure(error: Exception) -> bytes:
    """Errors travel as text, since not every exception survives pickling."""
    ours = isinstance(error, PushRecoveryError)
    return pickle.dumps((None, str(error) if ours else f"{type(error).__name__}: {error}"))


class RayWorkers(int):
    """A number of workers that are those of the Ray cluster this process is connected to."""


def ray_workers(address: str = LOCAL, workers: int | None = None) -> RayWorkers:
    """Connect to a Ray cluster, unless this process is connected already; its workers, for `workers=`.

        evaluate("two-stage", "hard", workers=ray_workers("auto"))

    Args:
        address: "local" starts a cluster of this machine alone; HOST:PORT, "auto" or ray://HOST:PORT names
            one that runs.
        workers: of a cluster of this machine, by default one a core; another one has as many as its machines
            have CPUs.

    Returns:
        Their number, which also says that they are the cluster's.

    Raises:
        MissingExtraError: Ray is not installed.
        InvalidValueError: nothing answers there within seconds, or it is no Ray cluster, or has no CPU.
        WorkerError: a cluster of this machine does not start.
    """
    if find_spec("ray") is None:
        raise MissingExtraError("ray", "ray")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # it would tell its makers of each use
    # What Ray says of workers that end goes to standard output, whose only content is a command's result.
    os.environ.setdefault("RAY_DEDUP_LOGS_SKIP_REGEX", "(?s).")
    ray: Any = import_module("ray")
    if not ray.is_initialized():
        _connect(ray, address, workers)
    cpus = int(ray.cluster_resources().get("CPU", 0))
    if cpus < 1:
        raise InvalidValueError(f"the Ray cluster {address!r} has no CPU")
    return RayWorkers(cpus)


def _connect(ray: Any, address: str, workers: int | None) -> None:
    quiet = {"log_to_driver": False, "logging_level": "ERROR"}
    if address == LOCAL:
        _start(ray, num_cpus=workers, include_dashboard=False, object_store_memory=STORE, **quiet)
        return
    try:
        _check(address)
        os.environ.setdefault("RAY_gcs_server_port_wait_time_s", "1")  # else Ray tries on for minutes
        ray.init(address, runtime_env={"env_vars": dict.fromkeys(THREAD_VARIABLES, "1")}, **quiet)
    except (ValueError, OSError, RuntimeError, ray.exceptions.RayError) as error:
        raise InvalidValueError(f"no Ray cluster at {address!r}: {error}".splitlines()[0]) from error


def _start(ray: Any, **options: Any) -> None:
    """Start a cluster of this machine; Ray gives up after 30 s, which a busy machine may take."""
    _one_thread_each()
    for left in reversed(range(STARTS)):
        try:
            ray.init(LOCAL, **options)
            return
        except Exception as error:  # Ray raises no other
            ray.shutdown()
            if not left:
                raise WorkerError(f"Ray does not start here: {error}") from error


def _check(address: str) -> None:
    """Raise OSError where nobody answers, which Ray finds out within a minute."""
    if address == "auto":
        return
    host, _, port = address.removeprefix(CLIENT).rpartition(":")
    if not (host and port.isdigit()):
        raise OSError(f"an address is HOST:PORT, {CLIENT}HOST:PORT, auto or {LOCAL}")
    with socket.create_connection((host.strip("[]"), int(port)), ANSWER):
        pass


class RayPool(Pool[S]):
    """Workers of the cluster that this process is connected to; arguments as those of `WorkerPool`.

    Their results are those of `WorkerPool`, bit for bit on machines of one kind. A worker makes its state
    once. Where a worker or its machine ends, its job is done again elsewhere.
    """

    def __init__(self, start: Callable[..., S], *arguments: Any):
        super().__init__()
        self._ray: Any = import_module("ray")
        self._perform = self._ray.remote(_perform_on_ray).options(num_cpus=1, max_retries=RETRIES)
        self._made = self._ray.put((os.getcwd(), sys.path, self._pickled((start, arguments))))
        self._tasks: dict[Future[bytes], Any] = {}  # Ray's names of those that are not done

    def _submit(self, task: Callable[[S, Any], Any], job: Any) -> Future[bytes]:
        reference = self._perform.remote(self._made.hex(), self._made, self._pickled((task, job)))
        future: Future[bytes] = reference.future()
        self._tasks[future] = reference
        future.add_done_callback(self._tasks.pop)
        return future

    def _pickled(self, content: Any) -> bytes:
        """For a worker to read once it knows the way to our modules; what `__main__` defines is in it."""
        return self._ray.cloudpickle.dumps(content)

    def _ended(self, error: Exception) -> str:
        if isinstance(error, self._ray.exceptions.RayError):
            return f"a worker of the Ray cluster ended {RETRIES + 1} times: {error}"
        return f"{type(error).__name__}: {error}"

    def close(self) -> None:
        """End what is not done."""
        for task in tuple(self._tasks.values()):
            with suppress(self._ray.exceptions.RayError):
                self._ray.cancel(task, force=True)
        self._pending, self._tasks = {}, {}


def _perform_on_ray(name: str, made: tuple[str, list[str], bytes], job: bytes) -> bytes:
    """`_answer` of a worker of a cluster, whose state is made where the process that asks for it works."""
    if name not in _STATE:
        folder, path, content = made
        with suppress(OSError):  # as far as both have that folder
            os.chdir(folder)
        sys.path += [place for place in path if place not in sys.path]
        _STATE.clear()
        _STATE[name] = _made(content)
    return _answer(*_STATE[name], job)
