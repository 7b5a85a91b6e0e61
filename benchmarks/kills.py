"""Long commands, killed, interrupted and doubled at random moments: do they end with the same rows?

python benchmarks/kills.py [--commands evaluate tune ...] [--kills 9] [--interrupts 5] [--writers 1]

Each command of `long_commands.py` runs once undisturbed, which gives the rows to compare with and the time
over which the moments are drawn. Then it is killed (SIGKILL, of the command alone) and started again, in
one directory until it ends there, then in the next; the rows of every directory must be those of the first.
Then Ctrl-C comes twice, as a terminal sends it, to every process: the command must be out within 3 s, with
exit code 130 (or that of its own end), with one line and no traceback, leave no process, and end with the
same rows when it is run again. Last a second one is started in the directory of one that is writing: it
must be refused in one line, and the first must end with the same rows. A training run that goes on meets
other pushes, so of it only the end is compared. `early` counts the Ctrl-C that came before Python had
loaded anything of this project. Exit code 1 where something fails.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from long_commands import COMMANDS, prepare
from push_recovery.eval.output.rows import LOCK

OUT_WITHIN = 3.0  # of the first Ctrl-C [s]
BETWEEN = 0.5  # two of them at most [s]
OURS = re.compile(r"push-recovery|src/push_recovery|(eval|training|envs|controllers)/\w")
ENDED = (0, 130)  # exit codes of a command that ended by itself, or was interrupted
REFUSED = 2  # exit code


@dataclass
class Found:
    """What became of one command."""

    kills: int = 0
    interrupts: int = 0
    early: int = 0  # of these: before Python had loaded anything
    writers: int = 0  # second ones
    compared: int = 0  # directories whose rows were compared
    slowest: float = 0.0  # from the first Ctrl-C to the end of the command [s]
    faults: list[str] = field(default_factory=list)

    @property
    def cells(self) -> tuple[str, ...]:
        """Of the table."""
        counts = (self.kills, self.interrupts, self.early, self.writers, self.compared)
        return (*map(str, counts), f"{self.slowest:.1f}", str(len(self.faults)))


class Trial:
    """One command in directories of its own.

    Args:
        name: of COMMANDS.
        place: of the directories.
        workers: processes of the command, where it takes any.
        draw: of the moments.
    """

    def __init__(self, name: str, place: Path, workers: int, draw: random.Random):
        prepare(place)
        self._command, self._workers = COMMANDS[name], workers
        self._place, self._draw = place, draw
        self._number, self.found = 0, Found()
        began = time.monotonic()
        self._whole = self._fresh()
        self._end(self._start(self._whole))
        self._time = time.monotonic() - began

    def kill(self, times: int) -> None:
        """Kill it so many times, and compare what each directory holds at its end."""
        out = self._fresh()
        while self.found.kills < times:
            process = self._start(out)
            if self._ends_within(process, self._draw.uniform(0.0, self._time)):
                out = self._compared(out)
                continue
            process.kill()
            process.communicate()
            self.found.kills += 1
            self._check_group(process, "a kill")
        self._end(self._start(out))
        self._compared(out)

    def interrupt(self, times: int) -> None:
        """Press Ctrl-C twice, so many times."""
        out = self._fresh()
        while self.found.interrupts < times:
            process = self._start(out)
            if self._ends_within(process, self._draw.uniform(0.0, self._time)):
                out = self._compared(out)
                continue
            self._press_twice(process)
        self._end(self._start(out))
        self._compared(out)

    def _press_twice(self, process: subprocess.Popen[str]) -> None:
        began = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(self._draw.uniform(0.0, BETWEEN))
        os.killpg(process.pid, signal.SIGINT)
        try:
            said = process.communicate(timeout=10 * OUT_WITHIN)[1]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            said = process.communicate()[1]
            self.found.faults.append("two Ctrl-C did not end it")
        took = time.monotonic() - began
        self.found.interrupts += 1
        self.found.slowest = max(self.found.slowest, took)
        if process.returncode not in ENDED and not OURS.search(said) and took <= OUT_WITHIN:
            self.found.early += 1
        elif process.returncode not in ENDED or "Traceback" in said or took > OUT_WITHIN:
            self.found.faults.append(f"Ctrl-C: code {process.returncode} after {took:.1f} s: {said[-2000:]}")
        self._check_group(process, "Ctrl-C")

    def write_twice(self, times: int) -> None:
        """Start a second one in the directory of the first, which stands still meanwhile, so many times."""
        for _ in range(times):
            out = self._fresh()
            first = self._stopped_while_writing(out)
            second = self._start(out)
            said = second.communicate()[1]
            os.kill(first.pid, signal.SIGCONT)
            self.found.writers += 1
            if second.returncode != REFUSED or "another run" not in said or len(said.splitlines()) > 1:
                self.found.faults.append(f"a second writer: code {second.returncode}: {said[-2000:]}")
            self._end(first)
            self._compared(out)

    def _stopped_while_writing(self, out: Path) -> subprocess.Popen[str]:
        """The command, stopped while it has the lock of a directory."""
        while True:
            process = self._start(out)
            while process.poll() is None:
                if any(out.rglob(LOCK)):
                    os.kill(process.pid, signal.SIGSTOP)
                    if any(out.rglob(LOCK)):
                        return process
                    os.kill(process.pid, signal.SIGCONT)
                time.sleep(0.005)
            self._end(process)
            shutil.rmtree(out)  # it was too quick

    def _start(self, out: Path) -> subprocess.Popen[str]:
        """The command in a process group of its own."""
        return subprocess.Popen(  # noqa: S603
            self._command.line(self._place, out, self._workers),
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip

    def _ends_within(self, process: subprocess.Popen[str], seconds: float) -> bool:
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        self._end(process)
        return True

    def _end(self, process: subprocess.Popen[str]) -> None:
        said = process.communicate()[1]
        if process.returncode != 0:
            self.found.faults.append(f"ended with {process.returncode}: {said[-2000:]}")

    def _check_group(self, process: subprocess.Popen[str], after: str) -> None:
        """A fault where a process that the command has started is still there."""
        end = time.monotonic() + OUT_WITHIN
        while time.monotonic() < end:
            try:
                os.killpg(process.pid, 0)
            except ProcessLookupError:
                return
            time.sleep(0.02)
        self.found.faults.append(f"processes were left by {after}")
        os.killpg(process.pid, signal.SIGKILL)

    def _fresh(self) -> Path:
        self._number += 1
        return self._place / str(self._number)

    def _compared(self, out: Path) -> Path:
        """Compare a directory with that of the run that nothing disturbed; returns the next one."""
        if self._command.content(out) != self._command.content(self._whole):
            self.found.faults.append(f"other rows than undisturbed: {out}")
        else:
            shutil.rmtree(out)
        self.found.compared += 1
        return self._fresh()


def main(argv: Sequence[str] | None = None) -> int:
    """Disturb the commands; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS), metavar="NAME")
    parser.add_argument("--kills", type=int, default=9, help="of each command")
    parser.add_argument("--interrupts", type=int, default=5, help="of each command, two Ctrl-C each")
    parser.add_argument("--writers", type=int, default=1, help="of each command that are refused")
    parser.add_argument("--workers", type=int, default=2, help="of each command")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    options = parser.parse_args(argv)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # children would inherit that it is ignored
    place = Path(tempfile.mkdtemp(prefix="kills-"))
    faults = 0
    print("| command | kills | two Ctrl-C | early | second writers | compared | slowest end [s] | faults |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for name in options.commands:
        trial = Trial(name, place / name, options.workers, random.Random(f"{options.seed} {name}"))  # noqa: S311
        trial.kill(options.kills)
        trial.interrupt(options.interrupts)
        trial.write_twice(options.writers)
        found = trial.found
        print("|", " | ".join((f"`{name}`", *found.cells)), "|", flush=True)
        for fault in found.faults:
            print(json.dumps(fault), file=sys.stderr)
        faults += len(found.faults)
    if faults:
        print(f"what is left of it: {place}", file=sys.stderr)
    else:
        shutil.rmtree(place)
    return 1 if faults else 0


if __name__ == "__main__":
    raise SystemExit(main())
