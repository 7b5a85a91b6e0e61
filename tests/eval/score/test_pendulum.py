import json

import numpy as np
import pytest
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.rollout.workers import Runner
from push_recovery.eval.score.frontier import FrontierSettings, ScanJob, scan
from push_recovery.eval.score.suites import Suite, standard_suite

ENV_ID = "PushRecovery/Pendulum-v0"
SUITE = Suite("head", "1", standard_suite().scenarios[:12])


@pytest.fixture(scope="module")
def runner():
    return Runner(ENV_ID)


@pytest.mark.parametrize("name", ["two-stage", "random"])
def test_order_changes_nothing(runner, name):
    first = [runner.run((name, scenario)).to_dict() for scenario in SUITE.scenarios[:6]]
    second = [runner.run((name, scenario)).to_dict() for scenario in SUITE.scenarios[5::-1]]
    assert json.dumps(first) == json.dumps(second[::-1])


def test_two_stage_recovers_more_than_passive(runner):
    recovered = {
        name: sum(runner.run((name, scenario)).recovered for scenario in SUITE.scenarios)
        for name in ("passive", "two-stage")
    }
    assert recovered["two-stage"] > recovered["passive"]


@pytest.mark.parametrize("psi", [-90.0, 30.0, 90.0])
def test_mirrored_scenario_has_the_mirrored_outcome(runner, psi):
    push = polar_push(300.0, np.radians(psi), 0.1, GaitEvent(4, "left", 0.3))
    scenario = Scenario("push", (push,), Command(0.2, 0.1))
    a, b = (runner.run(("two-stage", s)) for s in (scenario, scenario.mirrored()))
    assert (a.survived, a.recovered, a.failure_reason, a.env_steps) == (
        b.survived,
        b.recovered,
        b.failure_reason,
        b.env_steps,
    )
    assert a.total_reward == pytest.approx(b.total_reward, rel=1e-9)


def test_an_unpushed_walk_recovers_at_every_command(runner):
    for vx, vy in [(0.0, 0.0), (0.5, 0.0), (-0.25, 0.0), (0.0, 0.2), (0.0, -0.2)]:
        outcome = runner.run(("two-stage", Scenario("calm", (), Command(vx, vy), duration=6.0)))
        assert outcome.recovered
        assert outcome.end_time == pytest.approx(6.0, abs=0.011)


def test_frontier_lies_under_the_limit(runner):
    from push_recovery.controllers.model.capturability import max_recoverable_force

    for psi in (-90.0, 90.0):
        row = scan(runner, ScanJob(FrontierSettings(ENV_ID, 50.0), "two-stage", psi))
        limit = max_recoverable_force(runner.env.unwrapped.robot, np.radians(psi))  # type: ignore[attr-defined]
        assert 0.5 * limit < row["survived_N"] <= limit
