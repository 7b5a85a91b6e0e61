"""A preset that was made for another robot is refused, and the message says what differs."""

from dataclasses import asdict, replace

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.settings import PresetFile
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.description import check_preset


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
