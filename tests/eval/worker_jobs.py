"""What workers do in the tests of their pools. It needs little, so that a process begins soon."""

import os
import signal
import time

from push_recovery.controllers.errors import InvalidValueError


def base(number):
    if number < 0:
        raise ValueError(f"no state from {number}")
    return number


def complain(state, job):
    raise InvalidValueError(f"no push at {job}")


def add(state, job):
    if job < 0:
        raise KeyError("no such thing")
    return state + job


def refuse(state, job):
    return lambda: job  # which can't be handed back


def end(state, job):
    os._exit(3)


def rest(state, seconds):
    time.sleep(seconds)


def die_once(state, job):
    number, flag = job
    if number == 3 and not flag.exists():
        flag.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return state + number


def die(state, job):
    os.kill(os.getpid(), signal.SIGKILL)
