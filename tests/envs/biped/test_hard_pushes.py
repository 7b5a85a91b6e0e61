"""Pushes of any size that a scenario may have: all stays finite, and no other robot is touched."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.model_errors import BOUNDS
from push_recovery.envs.scenario.push import FORCE_MAX, Push
from push_recovery.envs.scenario.scenario import PROFILES, SENSING, Scenario

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
CALM = Push((30.0, 20.0, 0.0), 0.1, 0.06)
NOISE = {"dcm_noise": BOUNDS["dcm_noise"][2], "joint_noise": BOUNDS["joint_noise"][2]}  # the most
FORCES = (1e4, 1e6, FORCE_MAX)  # [N]


def hard_pushes() -> list[Push]:
    """Short and long, at both bodies, off their CoM, in directions drawn at random."""
    rng, pushes = np.random.default_rng(0), []
    for force, duration, body in itertools.product(FORCES, (1e-4, 0.1), ("pelvis", "trunk")):
        direction = rng.normal(size=3)
        vector = tuple((force * direction / np.abs(direction).max()).tolist())
        pushes.append(Push(vector, duration, 0.05, body, tuple(rng.uniform(-0.3, 0.3, 3).tolist())))
    return pushes


@pytest.mark.parametrize("sensing", SENSING)
@pytest.mark.parametrize("profile", PROFILES)
def test_the_hardest_pushes_end_only_the_robots_that_they_hit(profile, sensing, tmp_path, monkeypatch):
    """Every second robot that is hit has the most noise that there is, too."""
    monkeypatch.chdir(tmp_path)  # MuJoCo would write warnings into a file there
    pushes = hard_pushes()
    episodes = BipedEpisodes(1 + len(pushes))

    def walk(others: list[Push]) -> np.ndarray:
        seen = []
        for k, push in enumerate([CALM, *others]):
            scenario = PROFILES[profile].applied(Scenario("a", (push,), duration=1.0))
            errors = replace(scenario.errors, **NOISE) if k % 2 else scenario.errors
            episodes.begin(k, replace(scenario, errors=errors, sensing=sensing))
        for _ in range(40):
            actions = POLICY.predict(episodes.core.observation)[0]
            period = episodes.step(actions)
            assert np.isfinite(actions).all()
            assert np.isfinite(episodes.core.observation).all()
            assert np.isfinite(period.reward.total).all()
            seen.append(episodes.core.observation[0].copy())
        return np.array(seen)

    alone = walk([CALM] * len(pushes))
    np.testing.assert_array_equal(walk(pushes), alone)
    fell = episodes.failure()[1:] != 0
    assert episodes.failure()[0] == 0
    assert fell[[p.duration * max(map(abs, p.force)) >= 1e3 for p in pushes]].all()  # 16 m/s and more
    assert not list(tmp_path.iterdir())
