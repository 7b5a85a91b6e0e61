"""Profiles as values, and that drawn scenarios have them while given ones run as they are."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import UnknownNameError
from push_recovery.envs.scenario.model_errors import ModelErrors, PhysicsOptions
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import EXACT, HARDWARE, Scenario, get_profile

PUSHED = Scenario("a", (Push((60.0, 0.0, 0.0), 0.1, 1.0),), noise_seed=7)


def test_exact_changes_nothing():
    off = replace(PUSHED, errors=ModelErrors(mass=0.1), physics=PhysicsOptions(time_step=0.001))
    assert EXACT.applied(PUSHED) == PUSHED
    assert EXACT.applied(off) == off


def test_hardware_is_what_the_pages_say():
    applied = HARDWARE.applied(PUSHED)
    assert applied.to_dict()["errors"] == {
        "friction": 0.7, "delay": 0.004, "joint_friction": 1.0, "armature": 0.03, "collisions": True,
        "motor_power": 2000.0, "bus_power": 3000.0, "continuous_torque": 0.4,
    }  # fmt: skip
    assert applied.to_dict()["sensing"] == "onboard"
    assert applied.to_dict()["physics"] == {"time_step": 0.001, "cone": "elliptic", "impratio": 10.0}
    assert replace(applied, errors=PUSHED.errors, physics=PUSHED.physics, sensing="exact") == PUSHED


def test_what_a_scenario_says_itself_stands():
    own = replace(PUSHED, errors=ModelErrors(mass=0.1, friction=0.5), physics=PhysicsOptions(impratio=3.0))
    applied = HARDWARE.applied(own)
    assert (applied.errors.mass, applied.errors.friction, applied.errors.delay) == (0.1, 0.5, 0.004)
    assert (applied.physics.impratio, applied.physics.time_step) == (3.0, 0.001)
    assert HARDWARE.applied(own.mirrored()) == HARDWARE.applied(own).mirrored()


def test_an_unknown_profile_is_named_with_the_valid_ones():
    assert get_profile("hardware") is HARDWARE
    with pytest.raises(UnknownNameError, match="did you mean 'hardware'"):
        get_profile("hardwar")
    with pytest.raises(UnknownNameError, match="profile"):
        gym.make("push_recovery:PushRecovery/Biped-v0", profile="real")


@pytest.mark.parametrize("env_id", ["Biped", "BipedResidual"])
def test_an_environment_draws_robots_of_its_profile(env_id):
    name = f"push_recovery:PushRecovery/{env_id}-v0"
    drawn = []
    for profile in ("exact", "hardware"):
        env = gym.make(name, profile=profile)
        env.reset(seed=3)
        drawn.append(env.unwrapped.scenario)
        env.reset(options={"scenario": PUSHED})
        assert env.unwrapped.scenario == PUSHED
        env.close()
    assert drawn[1] == HARDWARE.applied(drawn[0])
    assert drawn[1] != drawn[0]


@pytest.mark.parametrize("env_id", ["Biped", "BipedResidual"])
def test_a_vector_of_robots_has_the_profile_too(env_id):
    seen = []
    for profile in ("exact", "hardware"):
        envs = gym.make_vec(
            f"push_recovery:PushRecovery/{env_id}-v0", 2, "vector_entry_point", profile=profile
        )
        envs.reset(seed=3)
        core = envs.unwrapped.core
        seen.append((core.errors.delay.tolist(), core.simulations.models[1].opt.timestep, core.senses.of(1)))
        alike = envs.unwrapped.episodes.alike(1)
        assert alike.drawn(envs.unwrapped.push_distribution, np.random.default_rng(0)).errors.collisions == (
            profile == "hardware"
        )
        envs.close()
    assert seen == [([0, 0], 0.002, 0), ([2, 2], 0.001, 1)]


@pytest.mark.parametrize(("sensing", "kind"), [(None, 1), ("exact", 0), ("onboard", 1)])
def test_a_sensing_of_the_environment_stands_above_the_profile(sensing, kind):
    env = gym.make("push_recovery:PushRecovery/Biped-v0", profile="hardware", sensing=sensing)
    env.reset(seed=3)
    assert env.unwrapped.episodes.core.senses.of(0) == kind
    env.close()
