"""Many pendulums at once against one environment, measurement errors, and scans against known limits."""

import json
import math
from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.observation import COM, COM_VELOCITY, DCM, PUSH_ESTIMATE, TRUNK_ANGLE
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.pendulum.env import PendulumEnv, PendulumEpisodes
from push_recovery.envs.scenario.distribution import PushDistribution
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.reproduction import pendulum
from push_recovery.eval.reproduction.jobs import EpisodeJob, ScanJob, key, scan
from push_recovery.eval.reproduction.pendulum import Measurement, PushKind, Variant, pairs, run_batch
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.rollout.workers import Runner
from push_recovery.eval.score import frontier


def pushes(vx=0.0, count=12):
    """Pushes up to what falls, in all directions, and a walk without any."""
    rng = np.random.default_rng(0)
    drawn = [PushDistribution(settle_time=2.5).sample(rng, f"drawn-{k}") for k in range(count - 3)]
    event = GaitEvent(4, "left", 0.0)
    start = [
        Scenario(f"start-{force}", (polar_push(force, -1.2, 0.1, event),), Command(vx), "left", 2.5)
        for force in (300.0, 750.0)
    ]
    two = (polar_push(90.0, 0.4, 0.1, 1.234), polar_push(80.0, 2.0, 0.05, GaitEvent(5, "right", 0.3)))
    return [*drawn, *start, Scenario("two", two, Command(vx), "right", 2.5), Scenario("none", duration=1.5)]


FIELDS = ("scenario_id", "survived", "recovered", "recovered_at", "failure_reason", "end_time")


def plain(outcome):
    return tuple(getattr(outcome, name) for name in FIELDS)


@pytest.mark.parametrize(
    ("variant", "vx", "settings"),
    [
        ("stage-1", 0.0, {}),
        ("two-stage", 0.5, {}),
        ("two-stage", 0.0, {"robot": RobotModel(pelvis_width=0.25, foot_width=0.08), "control_hz": 50.0}),
        ("two-stage", 0.0, {"preset": "double-support"}),
    ],
)
def test_the_batch_is_the_environment(variant, vx, settings):
    env, scenarios = PendulumEnv(**settings), pushes(vx)
    policy = make_policy(variant, env.robot, preset=settings.get("preset", "default"))
    single = [plain(rollout(env, policy, scenario, variant)) for scenario in scenarios]
    episodes = PendulumEpisodes(len(scenarios), **settings)
    if "preset" in settings:
        assert (episodes.touchdown_delay, episodes.double_support) == (0.0, 0.1)
    else:
        assert {survived for _, survived, *_ in single} == {True, False}
        assert any(recovered_at is not None for *_, recovered_at, _, _ in single)
    assert [plain(ending) for ending in run_batch(policy, scenarios, episodes)] == single


@pytest.mark.parametrize("measurement", [Measurement(), Measurement(dcm_noise=2e-3, delay=2)])
def test_neighbours_change_nothing(measurement):
    scenarios = pushes(count=8)
    policy = make_policy("two-stage")
    together = run_batch(policy, scenarios, measurement=measurement)
    reverse = run_batch(policy, scenarios[::-1], measurement=measurement)[::-1]
    alone = [run_batch(policy, [scenario], measurement=measurement)[0] for scenario in scenarios[:3]]
    assert together == reverse
    assert together[:3] == alone


class Watching:
    """Walks nominally and remembers what it saw."""

    def __init__(self):
        self.policy, self.seen = make_policy("passive"), []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.seen.append(observation.copy())
        return self.policy.predict(observation)


def watched(measurement, scenario):
    watching, cores = Watching(), []

    def watch(slots):
        core = slots.episodes.core
        s = core.state
        arrays = (s.com, s.velocity, s.stance, s.side, s.push, core.observation)
        cores.append([array[0].copy() for array in arrays])

    run_batch(watching, [scenario], measurement=measurement, watch=watch)
    return [seen[0] for seen in watching.seen], cores


PUSHED = Scenario("p", (polar_push(30.0, 0.7, 0.1, 0.9),), Command(0.2), duration=1.6, noise_seed=7)


def test_noise_is_white_of_the_stated_size_and_consistent():
    seen, cores = watched(Measurement(dcm_noise=3e-3), PUSHED)
    truth = [core[5] for core in cores][: len(seen)]
    omega = RobotModel().omega
    sign = np.array([[1.0, -1.0 if core[3] == 0 else 1.0] for core in cores])[: len(seen)]
    noise = sign * (np.array(seen)[:, DCM] - np.array(truth)[:, DCM])
    assert noise.std() == pytest.approx(3e-3, rel=0.1)
    assert abs(np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]) < 0.2
    for row in seen:
        assert row[DCM] == pytest.approx(row[COM] + row[COM_VELOCITY] / omega, abs=1e-14)
    growth = math.exp(omega * 0.01)
    push = sign * (np.array(seen)[:, PUSH_ESTIMATE] - np.array(truth)[:, PUSH_ESTIMATE])
    assert push[0] == pytest.approx([0.0, 0.0])
    assert push[1:] == pytest.approx((noise[1:] - growth * noise[:-1]) / (growth - 1.0), abs=1e-12)


def test_noise_is_that_of_the_seed():
    first, _ = watched(Measurement(dcm_noise=1e-3), PUSHED)
    again, _ = watched(Measurement(dcm_noise=1e-3), PUSHED)
    other, _ = watched(Measurement(dcm_noise=1e-3), Scenario(**{**vars(PUSHED), "noise_seed": 8}))
    assert np.array_equal(first, again)
    assert not np.array_equal(first[0], other[0])


def test_delay_shows_the_past_from_the_present_foot():
    delay = 4
    seen, cores = watched(Measurement(delay=delay), PUSHED)
    for k, row in enumerate(seen):
        com, velocity, _, _, push, _ = cores[max(k - delay, 0)]
        _, _, stance, side, _, truth = cores[k]
        sign = np.array([1.0, -1.0 if side == 0 else 1.0])
        assert row[COM] == pytest.approx(sign * (com - stance), abs=1e-14)
        assert row[COM_VELOCITY] == pytest.approx(sign * velocity, abs=1e-14)
        assert row[PUSH_ESTIMATE] == pytest.approx(sign * push, abs=1e-14)
        assert row[TRUNK_ANGLE] == pytest.approx(truth[TRUNK_ANGLE], abs=0.0)


def test_an_exact_sensor_hands_out_the_truth():
    class Core:
        observation = np.arange(3.0)

    assert pendulum.PendulumSensor(Core(), [PUSHED]).look() is Core.observation  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("action", "text"),
    [(np.zeros((1, 3)), r"shape \(1, 7\), got \(1, 3\)"), (np.full((1, 7), np.nan), "finite")],
)
def test_bad_actions_are_refused(action, text):
    bad: Any = SimpleNamespace(predict=lambda observation: (action, None))
    with pytest.raises(InvalidValueError, match=text):
        run_batch(bad, [PUSHED])


@pytest.mark.parametrize(
    "values", [{"dcm_noise": -1.0}, {"dcm_noise": math.nan}, {"delay": -1}, {"delay": 0.5}]
)
def test_measurement_is_checked(values):
    with pytest.raises(InvalidValueError, match=next(iter(values))):
        Measurement(**values)
    assert asdict(Measurement()) == {"dcm_noise": 0.0, "delay": 0}


def scanned(survives, *grids, unit=1.0):
    """Largest strength before the first failure, the largest survived, and failures."""
    return tuple(scan(lambda strengths: [survives(strength) for strength in strengths], grids, unit).values())


def test_a_scan_ends_100_newtons_past_the_first_failure_and_finer_grids_fill_the_interval_before_it():
    found = scanned(lambda force: force < 210 or 250 < force < 290, 20.0)
    assert found == (200.0, 280.0, [220.0, 240.0, 300.0, 320.0])
    found = scanned(lambda force: force < 213.5 or force == 218.0, 20.0, 5.0, 1.0)
    assert found == (213.0, 213.0, [214.0, 215.0, 220.0, 240.0, 260.0, 280.0, 300.0, 320.0])
    early_hole = scanned(lambda force: force != 60.0 and force < 400, 20.0, 5.0)
    assert early_hole == (55.0, 160.0, [60.0])
    survived, _, failed = scanned(lambda impulse: impulse < 31.25, 5.0, 1.0, unit=0.1)
    assert (survived, failed[-1]) == (31.2, 41.5)


@pytest.mark.parametrize(("limit", "survived"), [(0.0, 0.0), (0.5, 0.0), (3.2, 3.0), (1e9, 4000.0)])
def test_the_ends_of_the_range(limit, survived):
    assert scanned(lambda force: force < limit, 5.0, 1.0)[0] == survived


def test_agrees_with_the_frontier_of_the_environment():
    """The same numbers as `push-recovery frontier`, one episode at a time."""
    env_id, variant = "PushRecovery/Pendulum-v0", "stage-1+cop"
    runner = Runner(env_id)
    row = frontier.scan(runner, frontier.ScanJob(frontier.FrontierSettings(env_id, 20.0), variant, 90.0))
    runner.close()
    found = ScanJob(Variant("a", variant), PushKind(90.0), (20.0,)).run()
    strengths = {name: found[name] for name in ("survived", "largest_survived", "failed")}
    assert strengths == {name: row[f"{name}_N"] for name in strengths}
    assert found["unit"] == "N"


@pytest.mark.parametrize("duration", [0.1, 0.0])
def test_stage_1_reaches_the_limit_of_a_point_foot(duration):
    job = ScanJob(Variant("stage 1", "stage-1"), PushKind(-90.0, duration))
    limit = job.push.limit(job.variant, foot=False, flywheel=False)
    found = job.run()["survived"]
    assert 0.97 * limit < found <= limit + 1e-9


def test_noise_seeds_must_all_survive():
    variant = Variant("noisy", "stage-1", pairs({"push_carry": 0.0}), dcm_noise=0.01)
    job = ScanJob(variant, PushKind(-90.0), seeds=(1, 2, 3))
    forces = np.arange(200.0, 330.0, 15.0).tolist()
    alone = [replace(job, seeds=(seed,))._survives(forces) for seed in job.seeds]
    assert job._survives(forces) == [all(each) for each in zip(*alone, strict=True)]
    assert len({tuple(each) for each in alone}) > 1


def test_an_episode_is_one_scenario():
    variant = Variant("two-stage")
    low, high = (EpisodeJob(variant, PushKind(-90.0, vx=0.5), force).run() for force in (315.0, 700.0))
    assert low["recovered"]
    assert low["recovered_at"] > 2.7
    assert (high["survived"], high["failure_reason"]) == (False, "dcm_diverged")


def test_equal_variants_share_a_row_and_others_do_not():
    push = PushKind(0.0)
    base = Variant("a", planner=pairs({"beta_dcm": 1.0, "push_carry": 0.0}))
    same = Variant("b", planner=pairs({"push_carry": 0.0, "beta_dcm": 1.0}))
    assert key(ScanJob(base, push)) == key(ScanJob(same, push))
    changes = (
        {"policy": "stage-1"}, {"planner": ()}, {"robot": pairs({"mass": 50.0})}, {"control_hz": 50.0},
        {"preset": "paper"}, {"dcm_noise": 1e-3}, {"delay": 1},
    )  # fmt: skip
    others = [ScanJob(replace(base, **change), push) for change in changes]
    jobs = [ScanJob(base, push), *others, ScanJob(base, PushKind(1.0)), ScanJob(base, push, (5.0,))]
    assert len({key(job) for job in jobs}) == len(jobs)
    assert json.loads(json.dumps(base.identity())) == base.identity()


def test_a_variant_is_its_policy_and_robot_with_what_differs():
    variant = Variant("v", "two-stage-paper", pairs({"beta_dcm": 7.0}), pairs({"foot_width": 0.13}), 50.0)
    policy = variant.made_policy()
    config = make_policy("two-stage-paper").config
    assert policy.config == replace(config, beta_dcm=7.0, first_interval_min=0.02)  # type: ignore[attr-defined]
    episodes = variant.episodes(1)
    assert (episodes.limits.cop_y_max, episodes.control_hz, episodes.robot.pelvis_width) == (0.065, 50.0, 0.2)
    assert variant.made_policy() is policy


def test_a_velocity_jump_can_be_scanned_to_the_cap():
    """Its push lasts 0.1 ms, so the cap of 4000 N for 0.1 s is a force of 4 MN."""
    job = ScanJob(Variant("two-stage"), PushKind(0.0, duration=0.0))
    (push,) = job.push.scenario(frontier.FORCE_CAP * 0.1).pushes
    assert push.force[0] * push.duration == pytest.approx(400.0)
    assert job._survives([400.0]) == [False]
