"""Ids for a robot of one's own: made by gym.make, scored like the biped, refused with a reason."""

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.envs.robots.description import register_robot

PLACE = "push_recovery.envs.robots.variants:NO_WAIST_ROLL"


@pytest.fixture
def ids():
    found = register_robot("NoWaistRoll", PLACE)
    yield found
    for env_id in found:
        del gym.registry[env_id]


def test_the_ids_make_that_robot_alone_and_side_by_side(ids):
    forms = "", "Residual", "Joint", "JointResidual"
    assert ids == tuple(f"PushRecovery/NoWaistRoll{form}-v0" for form in forms)
    for env_id in ids:
        env, robots = gym.make(env_id), gym.make_vec(env_id, 2, vectorization_mode="vector_entry_point")
        assert env.unwrapped.core.body.model.nu == 13  # of the biped's 14 motors
        one, _ = env.reset(seed=3)
        both, _ = robots.reset(seed=[3, 4])
        assert np.array_equal(one, both[0])
        env.close()
        robots.close()


def test_its_preset_is_its_own(ids):
    assert gym.make(ids[0]).unwrapped.preset == "biped"
    assert gym.make(ids[0], preset="default").unwrapped.preset == "default"


def test_bad_names_and_places_are_refused(ids):
    with pytest.raises(InvalidValueError, match=r"^PushRecovery/NoWaistRoll-v0 is registered already"):
        register_robot("NoWaistRoll", PLACE)
    with pytest.raises(InvalidValueError, match=r"letters and digits only, got '../x'$"):
        register_robot("../x", PLACE)
    with pytest.raises(UnknownNameError, match=r"^unknown robot 'nowhere'"):
        register_robot("Mine", "nowhere")
    with pytest.raises(InvalidValueError, match=r"^cannot load robot 'nowhere:ROBOT'"):
        register_robot("Mine", "nowhere:ROBOT")
    assert not any("Mine" in env_id for env_id in gym.registry)
