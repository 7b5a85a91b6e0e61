"""Pushes of a suite that the closed-form limits leave to a controller, with and without sole and trunk.

python benchmarks/suite_limits.py [--suite varied]

A push F of duration d that begins at the time t of a nominal step finds the DCM at xi_0 exp(omega t) and
counts as a shift of it by F (1 - exp(-omega d)) / (m omega^2). It may be recovered from if what comes of
it lies within the bounds of `controllers/model/capturability.py` at t (docs/limits.md). Of several pushes
each meets the nominal gait. It is the pendulum's limit: no leg has to be swung, no torque to be found, no
turn is made.
"""

from __future__ import annotations

import argparse

from push_recovery.controllers.model.capturability import capture_margin
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.score.limits import pushed_start
from push_recovery.eval.score.report import groups_of
from push_recovery.eval.score.suites import get_suite

OWNED = {  # foot, flywheel
    "steps alone": (False, False),
    "and the sole": (True, False),
    "and the trunk": (False, True),
    "all": (True, True),
}


def margin(push: Push, command: Command, foot: bool, flywheel: bool) -> float:
    """Distance of the pushed DCM from its nearest bound [m]; negative: beyond recovery."""
    start = pushed_start(BIPED, BIPED_LIMITS, push, command)
    if start is None:
        raise SystemExit("error: only pushes at a moment of the gait have a limit")
    dcm = start.dcm + start.shift
    return capture_margin(BIPED, BIPED_LIMITS, start.elapsed, dcm, foot=foot, flywheel=flywheel)


def within(scenario: Scenario, foot: bool, flywheel: bool) -> bool:
    """Whether every push of a scenario lies within the limits."""
    return all(margin(push, scenario.command, foot, flywheel) >= 0.0 for push in scenario.pushes)


def main() -> None:
    """Print one row for all pushes, then one a group."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--suite", default="varied", help="name or file (default: %(default)s)")
    scenarios = get_suite(parser.parse_args().suite).scenarios
    held = {
        name: {scenario.id for scenario in scenarios if within(scenario, *owned)}
        for name, owned in OWNED.items()
    }
    groups = {"all": {scenario.id for scenario in scenarios}, **groups_of(scenarios)}
    print(f"| | pushes | {' | '.join(OWNED)} |\n|---{'|---' * (len(OWNED) + 1)}|")
    for group, ids in groups.items():
        cells = (len(held[name] & set(ids)) for name in OWNED)
        print(f"| {group} | {len(ids)} | {' | '.join(map(str, cells))} |")


if __name__ == "__main__":
    main()
