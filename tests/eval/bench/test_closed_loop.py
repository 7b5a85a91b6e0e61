"""The closed loop of many robots, as it is timed."""

import subprocess
import sys
from itertools import accumulate, cycle
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.eval.bench import closed_loop
from push_recovery.eval.bench.closed_loop import BatchTiming, batch_timings, memory_per_robot, time_control

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")


def test_rates_and_ratios():
    timing = BatchTiming(64, 2, physics=30.0, plan=5.0, core=45.0, period=0.01)
    assert timing.rtf == pytest.approx(200.0)
    assert timing.over_physics == pytest.approx(5.0 / 3.0)


def test_every_timed_robot_is_pushed_and_stands_to_the_end():
    core = closed_loop.walking_core(24, 2)
    for _ in range(closed_loop.WARM_UP + closed_loop.PERIODS):
        actions = POLICY.predict(core.observation)[0]
        core.step(BIPED_LIMITS.from_action(actions), actions.astype(np.float64))
    assert not core.gait.failure.any()
    assert np.all(np.linalg.norm(core.pushes.delivered, axis=(1, 2)) > 0.0)


def test_the_keys_of_the_contract(monkeypatch):
    monkeypatch.setattr(closed_loop, "ROBOTS", {1: (1,), 64: (1, 2), 256: (1,)})
    monkeypatch.setattr(closed_loop, "QUICK", (1, 64))
    monkeypatch.setattr(
        closed_loop,
        "time_batch",
        lambda policy, n, threads: BatchTiming(n, threads, 10.0, 1.0 * n, 1.0, 0.01),
    )
    content = batch_timings(POLICY, quick=True)
    assert "rtf_256_robots_1_threads" not in content
    assert "rtf_256_robots_1_threads" in batch_timings(POLICY)
    assert (content["vector_envs"], content["threads"]) == (64, 2)
    assert content["vector_env_rtf"] == content["rtf_64_robots_2_threads"] == pytest.approx(1e4 / 65.0)
    assert content["cost_over_physics_1_robots_1_threads"] == pytest.approx(0.2)


def test_memory_counts_the_robots(monkeypatch):
    seen = iter([100.0, 116.0])
    monkeypatch.setattr(closed_loop, "resident_mib", lambda: next(seen))
    monkeypatch.setattr(closed_loop, "MEMORY", 8)
    assert memory_per_robot(POLICY) == {"memory_mib_per_robot": 2.0}
    monkeypatch.setattr(closed_loop, "resident_mib", lambda: None)
    assert memory_per_robot(POLICY) == {}


def test_resident_memory_grows_with_what_is_used():
    if closed_loop.resident_mib() is None:
        pytest.skip("the system does not tell")
    code = (
        "import numpy as np; from push_recovery.eval.bench.closed_loop import resident_mib; "
        "before = resident_mib(); block = np.ones(64 * 2**17); print(resident_mib() - before)"
    )  # in a process of its own: what other tests freed may go back to the system at any time
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) == pytest.approx(64.0, abs=4.0)


def test_humanoid_runs_in_turn_with_the_bipeds(monkeypatch):
    turn = iter([10.0, 30.0, 30.0, 60.0, 20.0, 90.0])
    monkeypatch.setattr(closed_loop, "SLICES", 3)
    monkeypatch.setattr(closed_loop, "_humanoid", lambda env: next(turn))
    monkeypatch.setattr(closed_loop, "_bipeds", lambda core, policy: next(turn))
    content = closed_loop.humanoid_timings(POLICY)
    assert content == {"humanoid_rtf": 20.0, "biped_rtf": 60.0, "over_humanoid": 3.0}


def clock(*microseconds):
    """A clock whose calls lie so far apart, over and over."""
    times = accumulate(round(1e3 * time) for time in cycle(microseconds))
    return SimpleNamespace(perf_counter_ns=lambda: next(times))


def test_control_costs_what_the_core_takes_beyond_physics(monkeypatch):
    """Five physics steps of 2 ms take 1 ms bare, 4 ms with control: 10 simulated s a second, 600 us each."""
    monkeypatch.setattr(closed_loop, "CALLS", 3)
    monkeypatch.setattr(closed_loop, "time", clock(77.0, 1000.0, 4000.0))
    content = time_control(POLICY)
    assert content["raw_physics_rtf"] == pytest.approx(10.0)
    assert content["whole_body_us"] == {"median": pytest.approx(600.0), "p99": pytest.approx(600.0)}


def test_a_batch_is_timed_part_by_part_for_each_robot(monkeypatch):
    """Two robots: 1, 2 and 4 ms of physics, planner and core are half as much each."""
    monkeypatch.setattr(closed_loop, "PERIODS", 3)
    monkeypatch.setattr(closed_loop, "time", clock(77.0, 1000.0, 2000.0, 4000.0))
    timing = closed_loop.time_batch(POLICY, 2, 1)
    assert (timing.robots, timing.threads, timing.period) == (2, 1, pytest.approx(0.01))
    assert (timing.physics, timing.plan, timing.core) == pytest.approx((500.0, 1000.0, 2000.0))


def test_rates_beside_the_humanoid_are_simulated_over_wall_time(monkeypatch):
    """64 robots x 6 periods of 10 ms in 1 ms; 60 steps of 15 ms, each 1 ms."""
    monkeypatch.setattr(closed_loop, "advance", lambda *_: None)
    monkeypatch.setattr(closed_loop, "time", clock(1000.0))
    assert closed_loop._bipeds(SimpleNamespace(substeps=5), None) == pytest.approx(3840.0)
    monkeypatch.setattr(closed_loop, "time", clock(500.0, 1000.0))
    env = SimpleNamespace(
        action_space=SimpleNamespace(sample=lambda: 0), reset=closed_loop.time.perf_counter_ns,
        step=lambda action: (0, 0, False, False, {}), unwrapped=SimpleNamespace(dt=0.015),
    )  # fmt: skip
    assert closed_loop._humanoid(env) == pytest.approx(15.0)
