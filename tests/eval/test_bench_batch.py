"""The closed loop of many robots, as it is timed."""

import numpy as np
import pytest
from push_recovery.controllers.policies import TwoStagePolicy, make_policy
from push_recovery.envs.biped_env import BIPED, BIPED_LIMITS
from push_recovery.eval import bench_batch
from push_recovery.eval.bench_batch import PERIODS, WARM_UP, BatchTiming, batch_timings, walking_core

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")


def test_rates_and_ratios():
    timing = BatchTiming(64, 2, physics=30.0, plan=5.0, core=45.0, period=0.01)
    assert timing.rtf == pytest.approx(200.0)
    assert timing.over_physics == pytest.approx(5.0 / 3.0)


def test_every_timed_robot_is_pushed_and_stands_to_the_end():
    core = walking_core(24, 2)
    for _ in range(WARM_UP + PERIODS):
        actions = POLICY.predict(core.observation)[0]
        core.step(BIPED_LIMITS.from_action(actions), actions.astype(np.float64))
    assert not core.gait.failure.any()
    assert np.all(np.linalg.norm(core.pushes.delivered, axis=(1, 2)) > 0.0)


def test_the_keys_of_the_contract(monkeypatch):
    monkeypatch.setattr(bench_batch, "ROBOTS", (1, 64))
    assert isinstance(POLICY, TwoStagePolicy)
    monkeypatch.setattr(
        bench_batch,
        "time_batch",
        lambda policy, n, threads: BatchTiming(n, threads, 10.0, 1.0 * n, 1.0, 0.01),
    )
    content = batch_timings(POLICY)
    assert (content["vector_envs"], content["threads"]) == (64, 2)
    assert content["vector_env_rtf"] == content["rtf_64_robots_2_threads"] == pytest.approx(1e4 / 65.0)
    assert content["cost_over_physics_1_robots_1_threads"] == pytest.approx(0.2)
