"""Ids for a robot of one's own: made by gym.make, scored like the biped, refused with a reason.

A preset that was made for another robot is refused, and the message says what differs.
"""

from dataclasses import asdict, replace

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.settings import PresetFile
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.description import check_preset, register_robot

PLACE = "push_recovery.envs.robots.biped:NO_WAIST_ROLL"


@pytest.fixture
def ids():
    found = register_robot("NoWaistRoll", PLACE)
    yield found
    for env_id in found:
        del gym.registry[env_id]


def test_the_ids_make_that_robot_alone_and_side_by_side(ids):
    forms = "", "Residual", "Joint", "JointResidual", "FullBody"
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


def test_a_preset_that_says_whose_it_is_is_that_robots_alone(tmp_path):
    path = tmp_path / "own.json"
    PresetFile("biped", found={"robot": asdict(BIPED)}).save(path)
    check_preset(str(path), BIPED, BIPED_LIMITS)
    with pytest.raises(InvalidValueError, match=r"another robot .*: mass 60 there and 30 here$"):
        check_preset(str(path), replace(BIPED, mass=30.0), BIPED_LIMITS)


def test_a_sole_larger_than_the_robots_is_refused():
    check_preset("biped", BIPED, BIPED_LIMITS)
    check_preset("biped", RobotModel(foot_length=0.3, foot_width=0.12), BIPED_LIMITS)
    for small in (RobotModel(foot_length=0.17), RobotModel(foot_width=0.06)):
        with pytest.raises(InvalidValueError, match=r"is for a sole of 0\.2 x 0\.1 m, the robot's is 0\."):
            check_preset("biped", small, BIPED_LIMITS)


def test_environments_refuse_it(tmp_path):
    path = tmp_path / "other.json"
    PresetFile("biped", found={"robot": {"mass": 33.3}}).save(path)
    with pytest.raises(InvalidValueError, match=r"mass 33\.3 there and 60 here"):
        BipedEpisodes(1, preset=str(path))
