"""Pushes to tune on, from seeds of their own: of every kind, at the pelvis alone, or punches of the tour.

Of each there are two suites: one that a search meets, and one that is held out for what it has found. Their
run ids are none of the tour protocol's, so what is tuned on its punches has met none of the scored ones.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from ...controllers.model.capturability import max_recoverable_force
from ...controllers.model.robot import SAME, RobotModel, Similarity
from ...controllers.validation import require_choice
from ...envs.robots.compiled_robot import CompiledRobot
from ...envs.scenario.distribution import PushDistribution
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors, PhysicsOptions
from ...envs.scenario.scenario import EXACT, FASTEST_TURN, HARDWARE, Command, Profile, Scenario
from ..protocols.tour import FASTEST_X, FASTEST_Y, SLOWEST_X, tour_scenario
from ..score.draw import BLOCK, DRAWS, stratified_scenario, stratified_uniforms
from ..score.suites import OF_ROBOT, Suite, of_size

TAKEN = (12, 14, 16)  # punches of a run, all under the whole ceiling
FIRST, APART, SPREAD = 1.0, 2.5, 0.3  # when the first comes, how far apart they are, drawn later by up to [s]
LENGTH = 9.0  # of an excerpt [s]
IN_PLACE, STRAIGHT, KINDS = 0, 1, 4  # commands; the others are of everything at once


def excerpt(scenario_id: str, run_id: int, robot: CompiledRobot) -> Scenario:
    """Three of the hardest punches of a tour, on a robot that turns in place, walks straight on, or both."""
    rng, whole = np.random.default_rng(run_id), tour_scenario(run_id, robot)
    starts = [round(FIRST + APART * i + SPREAD * float(rng.random()), 4) for i in range(len(TAKEN))]
    pushes = [replace(whole.pushes[i], start=start) for i, start in zip(TAKEN, starts, strict=True)]
    velocity, kind = Similarity.of(robot.robot).velocity, int(rng.integers(KINDS))
    forward = 0.0 if kind == IN_PLACE else velocity * rng.uniform(SLOWEST_X, FASTEST_X)
    left = 0.0 if kind in {IN_PLACE, STRAIGHT} else velocity * rng.uniform(-FASTEST_Y, FASTEST_Y)
    turn = 0.0 if kind == STRAIGHT else rng.uniform(-FASTEST_TURN, FASTEST_TURN)
    return Scenario(
        scenario_id, tuple(pushes), Command(forward, left, turn), duration=LENGTH, noise_seed=run_id
    )


TUNING, VARIED, PUNCHES = "tuning", "tuning-varied", "tuning-punches"
VERSIONS = {TUNING: "1", VARIED: "2", PUNCHES: "1"}
SEEDS = {
    TUNING: 20260401, f"{TUNING}-held-out": 20260402,
    VARIED: 20261203, f"{VARIED}-held-out": 20261204,
}  # fmt: skip
FIRST_RUN = {PUNCHES: 3000, f"{PUNCHES}-held-out": 5000}  # of the tour, whose protocol has 0-63
BLOCKS = 4
SUITE_SIZE = BLOCKS * BLOCK  # scenarios of a suite
SHARE = (0.4, 2.0)  # of F*, whose step box is the paper's: on the biped about half is lost
FINE = Profile(  # what is tuned on one physics leans on it
    "fine", physics=PhysicsOptions(time_step=0.001, cone="elliptic", impratio=10.0, contact_time=0.004)
)
TURNS = EXACT, HARDWARE, FINE, HARDWARE  # profiles of the robots of `tuning-varied`, in turn
RANGES = PushDistribution(first_step=2, settle_time=3.0)  # falls come within 2 s of the push


def held_out_of(name: str) -> str:
    """The suite that is held out beside the one of this name."""
    return f"{name}-held-out"


def _pelvis_pushes(name: str, scenarios: int) -> list[Scenario]:
    """Like `standard`, but about the limit in every direction.

    The share of F* is uniform, so the rate recovered is the mean share survived, over directions, phases and
    commands, of those from SHARE[0] to SHARE[1].
    """

    def force(share: float, psi: float, side: str) -> float:
        """Force [N] at a share in [0, 1] of SHARE, on a left or right stance."""
        # F* is that of a left stance in place; a right stance is its mirror image
        limit = max_recoverable_force(RobotModel(), psi if side == "left" else -psi, RANGES.push_duration)
        return (SHARE[0] + share * (SHARE[1] - SHARE[0])) * limit

    points = stratified_uniforms(BLOCKS, 5, SEEDS[name])[:scenarios]
    return [
        stratified_scenario(f"{name}-{i:04d}", RANGES, force, u, SEEDS[name] + 4096 * i)
        for i, u in enumerate(points)
    ]


def _varied_pushes(name: str, scenarios: int) -> list[Scenario]:
    """Drawn like `varied`, the robots of TURNS in turn."""
    drawn = DRAWS["varied"].stratified(name, BLOCKS, SEEDS[name])[:scenarios]
    own = [replace(s, noise_seed=SEEDS[name] + 4096 * i) for i, s in enumerate(drawn)]
    return [TURNS[i % len(TURNS)].applied(s) for i, s in enumerate(own)]


DRAWN: dict[str, Callable[[str, int], list[Scenario]]] = {TUNING: _pelvis_pushes, VARIED: _varied_pushes}
TUNING_SUITES = (*DRAWN, PUNCHES)


@cache
def tuning_suite(
    name: str,
    scenarios: int,
    errors: ModelErrors = EXACT_MODEL,
    robot: tuple[str, Similarity] = ("biped", SAME),
) -> Suite:
    """The first scenarios of a suite of SEEDS; `errors` as in `_spoilt`, `robot` is its name and size."""
    require_choice("tuning suite", name, list(SEEDS))
    kind = name.removesuffix(held_out_of(""))
    suite = of_size(Suite(name, VERSIONS[kind], tuple(DRAWN[kind](name, scenarios))), *robot)
    return _spoilt(suite, errors)


def punched_suite(
    name: str, scenarios: int, robot: CompiledRobot, errors: ModelErrors = EXACT_MODEL
) -> Suite:
    """The first scenarios of a suite of FIRST_RUN, excerpts of the tour; `errors` as in `_spoilt`."""
    require_choice("tuning suite", name, list(FIRST_RUN))
    first = FIRST_RUN[name]
    drawn = tuple(excerpt(f"{name}-{i:04d}", first + i, robot) for i in range(scenarios))
    return _spoilt(Suite(f"{name}{OF_ROBOT}{robot.description.name}", VERSIONS[PUNCHES], drawn), errors)


def _spoilt(suite: Suite, errors: ModelErrors) -> Suite:
    """The suite with errors of every second robot, half of these with the mass error negated."""
    if errors == EXACT_MODEL:
        return suite
    both = errors, replace(errors, mass=-errors.mass)
    spoilt = [replace(s, errors=both[i // 2 % 2]) if i % 2 else s for i, s in enumerate(suite.scenarios)]
    return Suite(f"{suite.name}-half-{'-'.join(errors.names)}", suite.version, tuple(spoilt))
