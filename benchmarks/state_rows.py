"""State of n robots as arrays behind an address table, or as one structured array with a row a robot.

    python benchmarks/state_rows.py

Both hold `Gait` and `LimitsRecord` (row layout: nested records). Timed are a call that does nothing, and a
physics step's share of the bookkeeping: time passes, a plan is accepted, and limits that are met are counted.
Both give the same numbers bit for bit. The two are timed in turns; printed are the medians of their ratio.
"""

from __future__ import annotations

import argparse
import time
from typing import NamedTuple, get_type_hints

import numpy as np
from numba import njit
from push_recovery.controllers.array_table import array_fields, part_of, parts_table
from push_recovery.controllers.model.gait_box import DURATION
from push_recovery.controllers.whole_body.gait_machine import Gait, resting_gait
from push_recovery.envs.biped.limits_record import LimitsRecord, empty_record

DT, STEPS = 0.002, 200  # [s], steps a call


class Parts(NamedTuple):
    """State of the gait machine, and the limits met."""

    gait: Gait
    met: LimitsRecord


def row_type(parts: Parts) -> np.dtype:
    """One robot's row, a nested record a part; what robots have in common is left out."""
    nested = []
    for name, part in get_type_hints(Parts).items():
        values = getattr(parts, name)._asdict()
        fields = [
            (field, values[field].dtype, values[field].shape[1:])
            for field, notes in array_fields(part).items()
            if len(notes) == 1
        ]
        nested.append((name, fields))
    return np.dtype(nested, align=True)


@njit
def count(first, span, bits, now, dt):
    """Count the limits met, as bits, of one robot."""
    for i in range(first.shape[0]):
        if (bits >> i) & 1:
            first[i] = min(first[i], now)
            span[i] += dt


@njit
def step_arrays(t, n, steps, asked, dt):
    """Steps of n robots whose arrays lie behind an address table."""
    gait, met = part_of(t, Parts, "gait"), part_of(t, Parts, "met")
    for k in range(n):
        for s in range(steps):
            gait.elapsed[k] += dt
            gait.time[k] += dt
            if gait.elapsed[k] > gait.plan[k, DURATION]:
                gait.elapsed[k] = 0.0
                gait.steps[k] += 1
                for i in range(7):
                    gait.plan[k, i] = asked[k, i]
            met.plan[k] = (gait.steps[k] * 7 + s) & 4095
            count(met.first[k], met.span[k], met.plan[k], gait.time[k], dt)


@njit
def step_rows(rows, n, steps, asked, dt):
    """Steps of n robots of a row each."""
    for k in range(n):
        gait, met = rows[k].gait, rows[k].met
        for s in range(steps):
            gait.elapsed += dt
            gait.time += dt
            if gait.elapsed > gait.plan[DURATION]:
                gait.elapsed = 0.0
                gait.steps += 1
                for i in range(7):
                    gait.plan[i] = asked[k, i]
            met.plan = (gait.steps * 7 + s) & 4095
            count(met.first, met.span, met.plan, gait.time, dt)


def main() -> None:
    """Time both in turns."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--robots", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=400)
    options = parser.parse_args()
    n = options.robots
    parts = Parts(resting_gait(n), empty_record(n, np.zeros(13)))
    table, rows = parts_table(parts), np.zeros(n, row_type(parts))
    rows["met"]["first"] = np.inf
    asked = np.random.default_rng(0).uniform(0.2, 0.5, (n, 7))
    times: dict[tuple[str, str], list[float]] = {}
    for _ in range(options.rounds):
        for what, robots in (("call", 0), ("step", n)):
            for layout, run, state in (("arrays", step_arrays, table), ("rows", step_rows, rows)):
                begin = time.perf_counter()
                run(state, robots, STEPS, asked, DT)
                times.setdefault((what, layout), []).append(time.perf_counter() - begin)
    for part in Parts._fields:
        for name, array in getattr(parts, part)._asdict().items():
            if name in rows.dtype[part].names:
                np.testing.assert_array_equal(array, rows[part][name], f"{part}.{name}")
    for what, per, unit in (("call", 1, "a call"), ("step", n * STEPS, "a robot and step")):
        arrays, by_row = (np.array(times[what, layout][10:]) for layout in ("arrays", "rows"))
        micro = [1e9 * float(np.median(found)) / per for found in (arrays, by_row)]
        ratio = float(np.median(by_row / arrays))
        print(f"{what}: arrays {micro[0]:.1f} ns, rows {micro[1]:.1f} ns {unit}; rows / arrays {ratio:.3f}")


if __name__ == "__main__":
    main()
