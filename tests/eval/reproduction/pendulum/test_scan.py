"""Scans against robots whose limit is known, and against the closed form."""

import json
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.eval.reproduction.jobs import key
from push_recovery.eval.reproduction.pendulum import (
    EpisodeJob,
    PushKind,
    ScanJob,
    Variant,
    built,
    pairs,
    scan,
)
from push_recovery.eval.rollout.workers import Runner
from push_recovery.eval.score.frontier import FORCE_CAP, FrontierSettings
from push_recovery.eval.score.frontier import ScanJob as FrontierJob
from push_recovery.eval.score.frontier import scan as frontier_scan


class Holes:
    """Survives what a predicate accepts; remembers what it was asked."""

    def __init__(self, survives):
        self.survives, self.asked = survives, []

    def __call__(self, strengths):
        self.asked.append(list(strengths))
        return [bool(self.survives(strength)) for strength in strengths]


def test_scan_ends_100_newtons_past_the_first_failure():
    found = scan(Holes(lambda force: force < 210 or 250 < force < 290), (20.0,))
    assert (found["survived"], found["largest_survived"]) == (200.0, 280.0)
    assert found["failed"] == [220.0, 240.0, 300.0, 320.0]


def test_finer_grids_fill_the_last_interval():
    found = scan(Holes(lambda force: force < 213.5 or force == 218.0), (20.0, 5.0, 1.0))
    assert (found["survived"], found["largest_survived"]) == (213.0, 213.0)
    assert found["failed"][:3] == [214.0, 215.0, 220.0]
    assert found["failed"][-1] == 320.0


def test_an_early_hole_on_the_coarse_grid_is_the_first_failure():
    found = scan(Holes(lambda force: force != 60.0 and force < 400), (20.0, 5.0))
    assert (found["survived"], found["largest_survived"]) == (55.0, 160.0)


@pytest.mark.parametrize(("limit", "survived"), [(0.0, 0.0), (0.5, 0.0), (3.2, 3.0), (1e9, 4000.0)])
def test_the_ends_of_the_range(limit, survived):
    assert scan(Holes(lambda force: force < limit), (5.0, 1.0))["survived"] == survived


def test_a_unit_scales_everything():
    found = scan(Holes(lambda impulse: impulse < 31.25), (5.0, 1.0), unit=0.1)
    assert found["survived"] == 31.2
    assert found["failed"][-1] == 41.5


def test_agrees_with_the_frontier_of_the_environment():
    """The same numbers as `push-recovery frontier`, one episode at a time."""
    push = PushKind(90.0)
    runner = Runner("PushRecovery/Pendulum-v0")
    row = frontier_scan(
        runner, FrontierJob(FrontierSettings("PushRecovery/Pendulum-v0", 20.0), "stage-1+cop", 90.0)
    )
    runner.close()
    found = ScanJob(Variant("a", "stage-1+cop"), push, (20.0,)).run()
    assert (found["survived"], found["largest_survived"], found["failed"], found["unit"]) == (
        row["survived_N"],
        row["largest_survived_N"],
        row["failed_N"],
        "N",
    )


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


def test_a_variant_is_its_arm_with_what_differs():
    variant = Variant("v", "two-stage-paper", pairs({"beta_dcm": 7.0}), pairs({"foot_width": 0.13}), 50.0)
    policy, plant = built(variant)
    arm = make_policy("two-stage-paper").config
    assert policy.config == replace(arm, beta_dcm=7.0, first_interval_min=0.02)  # type: ignore[attr-defined]
    episodes = plant.episodes(1)
    assert (episodes.limits.cop_y_max, episodes.control_hz, episodes.robot.pelvis_width) == (0.065, 50.0, 0.2)
    assert built(variant)[0] is policy


def test_a_velocity_jump_can_be_scanned_to_the_cap():
    """Its push lasts 0.1 ms, so the cap of 4000 N for 0.1 s is a force of 4 MN."""
    job = ScanJob(Variant("two-stage"), PushKind(0.0, duration=0.0))
    (push,) = job.push.scenario(FORCE_CAP * 0.1).pushes
    assert push.force[0] * push.duration == pytest.approx(400.0)
    assert job._survives([400.0]) == [False]
