"""Robot files: written and read again, refused with the key or the value that is wrong."""

import json

import pytest
from push_recovery.controllers.errors import InvalidValueError, MissingExtraError, UnknownNameError
from push_recovery.envs.robots import model_files as model_place
from push_recovery.envs.robots.adapt import load_robot
from push_recovery.envs.robots.description import robot_description
from push_recovery.envs.robots.robot_file import read_robot_file, write_robot_file


@pytest.fixture
def written(robot_file, tmp_path):
    robot = robot_file(fixed=(("waist_roll", 0.1),), about="a test")
    write_robot_file(tmp_path / "theirs.json", robot, "biped")
    return tmp_path / "theirs.json", robot


def test_a_file_is_read_as_it_was_written(written):
    path, robot = written
    assert read_robot_file(path) == robot


def test_a_model_and_a_preset_beside_the_file_are_found_from_anywhere(written, tmp_path, monkeypatch):
    path, _ = written
    content = json.loads(path.read_text())
    (tmp_path / "own.json").touch()
    path.write_text(json.dumps(content | {"model": "theirs.xml", "preset": "own.json"}))
    monkeypatch.chdir("/")
    robot = read_robot_file(path)
    assert robot.model == str(tmp_path / "theirs.xml")
    assert robot.preset == str(tmp_path / "own.json")


def test_an_environment_takes_the_path_of_a_file(written):
    path, _ = written
    description = robot_description(str(path))
    assert description is load_robot(str(path))
    assert (description.name, description.com_height, description.preset) == ("theirs", 0.8, "biped")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "other"}, r"its 'format' is not 'push-recovery robot'"),
        ({"format_version": 9}, r"has format_version 9; this version reads 1"),
        ({"soles": [{"centre": [0, 0, 0]}]}, r"is not complete or has a value of another kind"),
        ({"legs": [["a"], ["b"]]}, r"the left leg of a BodyPlan has 6 joints"),
        ({"com_height": "high"}, r"is not complete or has a value of another kind"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(written, change, message):
    path, _ = written
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InvalidValueError, match=message):
        read_robot_file(path)


def test_an_unknown_key_is_named(written):
    path, _ = written
    path.write_text(json.dumps(json.loads(path.read_text()) | {"sole": []}))
    with pytest.raises(UnknownNameError, match=r"'sole'; did you mean 'soles'\?"):
        read_robot_file(path)


def test_a_missing_file_model_or_package_is_told(written, tmp_path, monkeypatch):
    with pytest.raises(InvalidValueError, match=r"^cannot read robot file"):
        read_robot_file(tmp_path / "none.json")
    with pytest.raises(InvalidValueError, match=r"^there is no model 'none.xml'$"):
        model_place.read_model("none.xml")
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody>")
    with pytest.raises(InvalidValueError, match=r"^MuJoCo cannot read the model"):
        model_place.read_model(str(tmp_path / "broken.xml"))
    monkeypatch.setattr(model_place, "find_spec", lambda name: None)
    with pytest.raises(
        MissingExtraError, match=r"jvrc-description is not installed.*push-recovery\[robots\]"
    ):
        model_place.read_model("jvrc_description/urdf/jvrc1.urdf")
