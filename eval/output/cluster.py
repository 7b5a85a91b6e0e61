"""Worker processes on a Ray cluster: many machines, or this one."""

from __future__ import annotations

import os
import pickle
import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from typing import Any, TypeVar

from ...controllers.errors import InvalidValueError, MissingExtraError
from .processes import THREAD_VARIABLES, Pool, WorkerError

S = TypeVar("S")
J = TypeVar("J")
R = TypeVar("R")
LOCAL = "local"  # address of a cluster of this machine alone, which ends with this process
CLIENT = "ray://"  # before the address of a cluster that this machine is no part of
STORE = 80 * 2**20  # memory for what workers are handed, where the cluster is this process's own [B]
ANSWER = 5.0  # that an address has to answer [s]
STARTS = 3  # of a cluster of this machine that are tried
RETRIES = 3  # of a task whose worker has ended
TASKS_A_WORKER = 4  # at least, so that no worker is idle for long at the end
JOBS_A_TASK = 16  # at most
_STATE: dict[str, Any] = {}  # of this worker, by the name of its pool; one at a time


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
    else:
        try:
            _check(address)
            os.environ.setdefault("RAY_gcs_server_port_wait_time_s", "1")  # else Ray tries on for minutes
            ray.init(address, runtime_env={"env_vars": dict.fromkeys(THREAD_VARIABLES, "1")}, **quiet)
        except (ValueError, OSError, RuntimeError, ray.exceptions.RayError) as error:
            raise InvalidValueError(f"no Ray cluster at {address!r}: {error}".splitlines()[0]) from error
    # What Ray says of workers that end goes to standard output, whose only content is a command's result.
    vars(import_module("ray._private.worker"))["_worker_logs_enabled"] = False


def _start(ray: Any, **options: Any) -> None:
    """Start a cluster of this machine; Ray gives up after 30 s, which a busy machine may take."""
    for name in THREAD_VARIABLES:  # its processes inherit them
        os.environ.setdefault(name, "1")
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
    """Workers of the cluster that this process is connected to; a context manager.

    Their results are those of `WorkerPool`, bit for bit on machines of one kind. A worker makes its state
    once. Where a worker or its machine ends, its task is done again elsewhere.

    Args:
        workers: how many the cluster has; those that come later get work, too.
        start: makes the state of a worker, in the worker; what it raises is told in the place of a result.
        arguments: of `start`; picklable.
    """

    def __init__(self, workers: int, start: Callable[..., S], *arguments: Any):
        self._ray: Any = import_module("ray")
        self._perform = self._ray.remote(_perform).options(num_cpus=1, max_retries=RETRIES)
        self._workers = workers
        self._made = self._ray.put((os.getcwd(), sys.path, self._pickled((start, arguments))))
        self._waiting: list[Any] = []

    def run(self, task: Callable[[S, J], R], jobs: Sequence[J]) -> Iterator[tuple[int, R]]:
        """Number and result of every job, as they finish; neighbours share a task, which tells each at once.

        Args:
            task: function of a worker's state and a job.
            jobs: picklable.

        Raises:
            WorkerError: a task raised, or the workers that had it ended time after time.
        """
        numbered, size = list(enumerate(jobs)), jobs_a_task(len(jobs), self._workers)
        parts = [numbered[i : i + size] for i in range(0, len(numbered), size)]
        name = self._made.hex()
        todo = (self._pickled((task, part)) for part in parts)
        self._waiting = [self._perform.remote(name, self._made, part) for part in todo]
        while self._waiting:
            (ready, *_), _ = self._ray.wait(self._waiting)
            try:
                number, result, error = self._ray.get(next(ready))
            except StopIteration:
                self._waiting.remove(ready)
                continue
            except self._ray.exceptions.RayError as ended:
                self._waiting.remove(ready)
                raise WorkerError(
                    f"a worker of the Ray cluster ended {RETRIES + 1} times: {ended}"
                ) from ended
            if error is not None:
                self._waiting.remove(ready)  # it ends by itself; to end it, too, can bring Ray down
                raise WorkerError(error)
            yield number, result

    def _pickled(self, content: Any) -> bytes:
        """For a worker to read once it knows the way to our modules; what `__main__` defines is in it."""
        return self._ray.cloudpickle.dumps(content)

    def close(self) -> None:
        """End what is not done."""
        for task in self._waiting:
            with suppress(self._ray.exceptions.RayError):
                self._ray.cancel(task, force=True)
        self._waiting = []


def jobs_a_task(jobs: int, workers: int) -> int:
    """How many jobs make a task: up to JOBS_A_TASK, as long as each worker gets TASKS_A_WORKER of them."""
    return max(1, min(JOBS_A_TASK, jobs // (TASKS_A_WORKER * max(workers, 1))))


def _perform(
    name: str, made: tuple[str, list[str], bytes], part: bytes
) -> Iterator[tuple[int | None, Any, str | None]]:
    """What a worker does: (number, result, None) of each job, or the words of the first error."""
    try:
        if name not in _STATE:
            _STATE.clear()
            _STATE[name] = _state(*made)
        task, jobs = pickle.loads(part)  # noqa: S301  # of the process that asks for it
        for number, job in jobs:
            yield number, task(_STATE[name], job), None
    except Exception as error:
        yield None, None, f"{type(error).__name__}: {error}"


def _state(folder: str, path: list[str], made: bytes) -> Any:
    """A worker's state, made where the process that asks for it works, as far as both have that folder."""
    with suppress(OSError):
        os.chdir(folder)
    sys.path += [place for place in path if place not in sys.path]
    start, arguments = pickle.loads(made)  # noqa: S301
    return start(*arguments)
