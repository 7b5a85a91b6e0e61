"""Ranges on threads."""

import copy
import multiprocessing
import threading

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.jit import RangeThreads


@pytest.mark.parametrize(("threads", "n"), [(1, 5), (2, 5), (3, 3), (4, 2), (2, 1), (3, 17)])
def test_the_ranges_cover_all_once_with_a_worker_each(threads, n):
    calls, meeting = [], threading.Barrier(min(threads, n))

    def job(worker, first, end):
        meeting.wait(10.0)  # all ranges are under way at the same time
        calls.append((worker, first, end))

    RangeThreads(threads).run(job, n)
    assert [worker for worker, _, _ in sorted(calls)] == list(range(min(threads, n)))
    assert sorted(i for _, first, end in calls for i in range(first, end)) == list(range(n))
    lengths = [end - first for _, first, end in calls]
    assert max(lengths) - min(lengths) <= 1


def test_the_first_range_runs_in_the_calling_thread():
    names = {}
    RangeThreads(2).run(lambda worker, first, end: names.update({worker: threading.current_thread()}), 4)
    assert names[0] is threading.current_thread()
    assert names[1] is not names[0]


@pytest.mark.parametrize(("n", "calls"), [(1, 1), (19, 1), (20, 2), (39, 3), (400, 4)])
def test_few_problems_are_not_worth_a_thread(n, calls):
    ranges = []
    RangeThreads(4).run(lambda *job: ranges.append(job), n, least=10 if n != 39 else 13)
    assert len(ranges) == calls


@pytest.mark.parametrize("culprit", [0, 1])
def test_an_error_of_any_range_is_raised_when_all_are_done(culprit):
    done = []

    def job(worker, first, end):
        if worker == culprit:
            raise ArithmeticError(f"worker {worker}")
        done.append(worker)

    with pytest.raises(ArithmeticError, match=f"worker {culprit}"):
        RangeThreads(2).run(job, 2)
    assert done == [1 - culprit]


def _count_in_child(pool: RangeThreads, queue) -> None:
    calls = []
    pool.run(lambda *job: calls.append(job), 4)
    queue.put(len(calls))


def test_a_forked_process_starts_its_own():
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("no fork on this system")
    pool, context = RangeThreads(2), multiprocessing.get_context("fork")
    pool.run(lambda *job: None, 4)
    queue = context.SimpleQueue()
    child = context.Process(target=_count_in_child, args=(pool, queue))
    child.start()
    child.join(10.0)
    alive = child.is_alive()
    child.kill()
    assert not alive
    assert queue.get() == 2


def test_a_copy_has_threads_of_its_own():
    pool = RangeThreads(3)
    pool.run(lambda *job: None, 4)
    assert copy.deepcopy(pool).threads == 3


@pytest.mark.parametrize("threads", [0, -1, 1.5, True, "two"])
def test_impossible_numbers(threads):
    with pytest.raises(InvalidValueError, match="threads must be a whole number from 1 to 1024, got"):
        RangeThreads(threads)
