"""What users hand to an environment by mistake: an error of this package, and nothing changed by it."""

import copy
import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.envs.biped.env import BipedEnv, BipedEpisodes
from push_recovery.envs.episode.gym_env import check_action
from push_recovery.envs.pendulum.env import PendulumEnv, PendulumEpisodes, make_pendulum_vector
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario

BEYOND_FLOATS = 10**400


@pytest.mark.parametrize(
    "action",
    [
        np.zeros(7) + 0j,
        np.full(7, 0.5 + 1j, np.complex64),
        ["0"] * 7,
        [None] * 7,
        [[0.0], [0.0, 0.0]],
        "abc",
        [math.nan] + [0.0] * 6,
        [math.inf] + [0.0] * 6,
        [-math.inf] + [0.0] * 6,
    ],
)
def test_actions_that_are_no_finite_real_numbers_are_refused(action):
    with pytest.raises(InvalidValueError, match="action"):
        check_action(action)


@pytest.mark.parametrize(
    ("action", "clipped"),
    [
        ([1e300, -1e300, 1e30, -1e30, 0.25, -0.5, 1.0], [1, -1, 1, -1, 0.25, -0.5, 1]),
        ([BEYOND_FLOATS, -BEYOND_FLOATS, 3, 0, 0, -1, 1], [1, -1, 1, 0, 0, -1, 1]),
        (np.array([2, -2, 0, 1, -1, 0, 0]), [1, -1, 0, 1, -1, 0, 0]),
        (np.array([1.5, -1.5, 0.1, 0.2, 0.3, 0.4, -0.9], np.float32), [1, -1, 0.1, 0.2, 0.3, 0.4, -0.9]),
    ],
)
def test_finite_actions_of_any_size_are_clipped_alike(action, clipped):
    checked = check_action(action)
    assert checked.dtype == np.float32
    np.testing.assert_array_equal(checked, np.array(clipped, np.float32))


def test_an_action_is_copied_before_it_is_clipped():
    action = np.full(7, 3.0, np.float32)
    check_action(action)
    assert (action == 3.0).all()


@pytest.mark.parametrize("seed", [1.5, -1, "1", True, math.nan])
def test_seeds_are_whole_numbers_from_zero(seed):
    for env in (PendulumEnv(), make_pendulum_vector(2)):
        with pytest.raises(InvalidValueError, match="seed must be"):
            env.reset(seed=seed)


def test_options_of_other_keys_are_named():
    for env in (PendulumEnv(), make_pendulum_vector(2)):
        with pytest.raises(UnknownNameError, match="unknown reset option 1 "):
            env.reset(options={1: 2, "a": 3})


@pytest.mark.parametrize("mask", [[[True], [True, False]], [1, 0], "no", None])
def test_a_reset_mask_is_one_truth_a_robot(mask):
    with pytest.raises(InvalidValueError, match=r"options\['reset_mask'\] must be 2 booleans"):
        make_pendulum_vector(2).reset(options={"reset_mask": mask})


@pytest.mark.parametrize("name", ["robot", "limits"])
def test_robot_and_limits_are_of_their_kind(name):
    with pytest.raises(InvalidValueError, match=rf"{name} must be a (RobotModel|GaitLimits), got 3"):
        PendulumEpisodes(1, **{name: 3})


@pytest.mark.parametrize("n", [0, -1, 1.0, True, 10**12, BEYOND_FLOATS])
def test_the_number_of_robots_has_bounds(n):
    with pytest.raises(InvalidValueError, match=r"num_envs must be an integer in \[1, 100000\]"):
        PendulumEpisodes(n)


@pytest.mark.parametrize("threads", [0, 10**6, 1.5])
def test_the_number_of_threads_has_bounds(threads):
    with pytest.raises(InvalidValueError, match="threads must be a whole number from 1 to 1024"):
        BipedEpisodes(1, threads=threads)


def test_a_copied_pendulum_goes_its_own_way():
    env = PendulumEnv()
    env.reset(seed=1)
    other = copy.copy(env)
    before = other.core.observation.copy()
    env.step(np.zeros(7, np.float32))
    np.testing.assert_array_equal(other.core.observation, before)
    there, here = other.step(np.zeros(7, np.float32)), env.core.observation[0]
    np.testing.assert_array_equal(there[0], here)


@pytest.mark.parametrize("part", ["", "episodes", "core"])
def test_a_biped_refuses_to_be_copied_as_it_refuses_to_be_pickled(part):
    env = BipedEnv()
    with pytest.raises(InvalidValueError, match="cannot be copied or pickled"):
        copy.copy(getattr(env, part) if part else env)


def test_a_copied_vector_environment_shares_nothing():
    env = make_pendulum_vector(2)
    env.reset(seed=1)
    other = copy.copy(env)
    env.step(np.zeros((2, 7), np.float32))
    assert other.episodes.robots.time.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("force", [1e12, 1e16, 1e50, 1e300, math.nan])
def test_a_state_that_overflows_ends_that_robot_and_touches_no_other(force, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings into a file there
    episodes, gait = BipedEpisodes(3), np.zeros((3, 7), np.float32)

    def walk(pushed: float) -> list[tuple]:
        for k in range(3):
            episodes.begin(k, Scenario("a", (Push((1.0, 0.0, 0.0), 0.1, 0.045),), duration=1.0))
        episodes.core.pushes.force[1, 0, 0] = pushed  # no scenario may have such a one
        out = []
        for _ in range(8):
            period = episodes.step(gait)
            seen = episodes.core.observation.copy(), period.reward.total.copy(), episodes.robots.time.copy()
            out.append((*seen, period.failed.copy()))
        return out

    calm, wild = walk(1.0), walk(force)
    assert episodes.failures[episodes.failure()[1]] == "not_finite"
    assert wild[-1][-1].tolist() == [False, True, False]
    for there, here in zip(calm, wild, strict=True):
        for now, then in zip(here, there, strict=True):
            np.testing.assert_array_equal(now[[0, 2]], then[[0, 2]])
            assert np.isfinite(now).all()
