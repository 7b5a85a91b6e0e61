"""A robot out of a model: what its legs and motors let its steps be, and files that an environment takes."""

import json
import math
import re
from dataclasses import replace

import gymnasium as gym
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.capturability import max_recoverable_force
from push_recovery.controllers.settings import load_preset, named_preset
from push_recovery.envs.biped.core import biped_settings
from push_recovery.envs.robots.adapt import load_robot
from push_recovery.envs.robots.biped import BIPED, ROBOT, biped, spec
from push_recovery.envs.robots.compiled_robot import CompiledRobot, compiled_robot, robot_digest
from push_recovery.envs.robots.description import RobotDescription, register_robot, robot_description
from push_recovery.eval.cli.main import main
from push_recovery.eval.robot_tools import new_robot as tools
from push_recovery.eval.robot_tools.new_robot import (
    new_robot,
    reachable_steps,
    save,
    scale_of,
    scaled_settings,
)
from push_recovery.eval.rollout.environments import EnvName, make_env, preset_digest

from ...envs.robots.wordings import Wording

ROLL, PITCH = 1, 2  # of the biped's hip, which turns first
LEG = "left_thigh", "left_shank", "left_foot"


def weaker(factor: float) -> CompiledRobot:
    """The biped, its hip motors with a share of their torque."""
    base = robot_description("biped")

    def spec():
        made = base.spec()
        for motor in made.actuators:
            if "hip" in motor.name:
                motor.forcerange = [factor * bound for bound in motor.forcerange]
        return made

    return compiled_robot(RobotDescription(f"weaker {factor}", spec, base.plan, base.com_height))


def test_a_hip_swings_all_that_hangs_from_it():
    """By the parallel axes of thigh, shank and foot, and the motor's armature."""
    body = biped()
    model, data = body.model, body.in_reference_posture()
    found = []
    for place in (ROLL, PITCH):
        joint = body.indices.legs[0][place]
        axis, anchor = data.xaxis[joint], data.xanchor[joint]
        inertia = model.dof_armature[model.jnt_dofadr[joint]]
        for name in LEG:
            part = model.body(name).id
            arm, frame = data.xipos[part] - anchor, data.ximat[part].reshape(3, 3)
            inertia += model.body_inertia[part] @ (frame.T @ axis) ** 2
            inertia += model.body_mass[part] * (arm @ arm - (arm @ axis) ** 2)
        height = anchor[2] - data.site_xpos[body.indices.soles[0], 2]
        found.append(body.motors[0, 2 + place] * height / inertia)
    assert tools.sole_acceleration(body) == pytest.approx(min(found), rel=1e-9)


def test_weak_hips_make_the_shortest_step_longer_and_leave_the_nominal_one():
    weak, own = weaker(0.25), named_preset("biped").robot()
    assert scale_of(weak).swing == pytest.approx(0.25)
    box, other = scaled_settings(weak).robot(), own["limits"]
    assert box["limits"]["duration_min"] == pytest.approx(2.0 * other["duration_min"], rel=1e-4)
    assert box["limits"]["duration_min"] + box["limits"]["duration_max"] == pytest.approx(
        other["duration_min"] + other["duration_max"], abs=1e-3
    )
    assert box["gains"]["swing_max"] == pytest.approx(0.25 * own["gains"]["swing_max"], rel=1e-4)


def test_very_weak_hips_leave_room_between_the_shortest_and_the_longest_step():
    limits = scaled_settings(weaker(0.04)).robot()["limits"]  # five times the shortest step
    assert limits["duration_min"] == pytest.approx(5.0 * 0.115, rel=1e-4)
    assert limits["duration_max"] == pytest.approx(1.2 * limits["duration_min"], abs=1e-3)


STRAIGHT, HIP, ANKLE = 0.72, 0.69, 0.06  # the biped's leg; hips and ankles over the floor as it walks [m]


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "mine.xml"
    path.write_text(spec().to_xml(), encoding="utf-8")
    return path


def test_the_biped_stands_as_high_as_it_walks():
    assert tools.standing_height(ROBOT) == pytest.approx(BIPED.com_height, abs=0.006)


def test_steps_end_where_the_legs_do():
    """Half a step is a side of the triangle of hip and ankle, whose long side is at most a straight leg."""
    steps = reachable_steps(ROBOT, 0.8)
    low = HIP - ANKLE - 0.24 * 0.8
    longest = 2.0 * (STRAIGHT**2 - low**2) ** 0.5
    assert 0.7 * longest < steps["length_max"] <= longest + 0.05
    assert steps["length_min"] < -0.5
    assert steps["width_max"] > 0.6


def test_a_range_of_the_ankle_ends_a_step():
    stiff = spec()
    for side in ("left", "right"):
        stiff.joint(f"{side}_ankle_roll").range = [-10.0, 10.0]  # degrees
    narrow = reachable_steps(replace(ROBOT, name="stiff", spec=lambda: stiff.copy()), 0.8)
    assert narrow["width_max"] < 0.6 < reachable_steps(ROBOT, 0.8)["width_max"]


def test_the_bipeds_own_model_gives_its_robot_again(model):
    robot = new_robot(str(model), "mine")
    found = robot.body.robot
    assert found.mass == pytest.approx(60.0)
    assert (found.foot_length, found.foot_width) == pytest.approx((0.2, 0.1))
    assert found.trunk_inertia == pytest.approx(8.0, rel=0.01)
    assert robot.preset.robot()["gains"]["swing_kp"] == pytest.approx(341.0, rel=0.02)
    box = biped_settings("biped").of_robot(found).limits
    alike = [max_recoverable_force(found, psi, 0.1, limits=box) for psi in (0.0, 0.7853981633974483)]
    assert robot.limits[:2] == pytest.approx(alike, rel=0.05)


def test_the_command_writes_what_an_environment_takes(model, tmp_path, capsys):
    assert main(["robot", "new", str(model), "--out", str(tmp_path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    path = tmp_path / "mine.robot.json"
    assert told["files"] == [str(path), str(tmp_path / "mine.preset.json")]
    assert told["waist"] == ["waist_pitch", "waist_roll"]
    assert len(told["limit_N"]) == 8
    assert load_preset(load_robot(str(path)).preset).found["robot"] == told["robot"]
    assert EnvName.parse(str(path)).label == "mine"
    assert set(preset_digest(str(path))) == {"robot_sha256"}
    env = make_env(str(path))
    assert env.unwrapped.robot.mass == pytest.approx(60.0)
    assert env.unwrapped.core.body is compiled_robot(load_robot(str(path)))
    env.close()


def test_the_command_tells_what_it_guessed_for_review(model, tmp_path, capsys):
    assert main(["robot", "new", str(model), "--name", "../x"]) == 2
    assert "letters, digits" in capsys.readouterr().err
    out = tmp_path / "my robots"
    assert main(["robot", "new", str(model), "--out", str(out), "--name", "mine"]) == 0
    told = capsys.readouterr().out
    assert "left_hip_yaw, left_hip_roll, left_hip_pitch, left_knee, left_ankle_pitch, left_ankle_roll" in told
    assert "0.2 x 0.1 and 0.2 x 0.1" in told
    assert f"push-recovery evaluate --env '{out}/mine.robot.json'" in told


def test_joints_without_a_torque_are_told(tmp_path):
    model = spec()
    for actuator in list(model.actuators):
        model.delete(actuator)
    path = tmp_path / "weak.xml"
    path.write_text(model.to_xml(), encoding="utf-8")
    message = r"does not tell the largest torque of waist_pitch, waist_roll, left"
    with pytest.raises(InvalidValueError, match=message):
        new_robot(str(path), "weak")


@pytest.fixture
def worded(tmp_path):
    def write(name, **words):
        path = tmp_path / name / "worded.xml"
        path.parent.mkdir()
        path.write_text(Wording(words.pop("seed", None)).text(**words), encoding="utf-8")
        return path

    return write


def test_one_model_in_other_words_makes_the_same_files(worded, tmp_path):
    written = []
    for seed in (None, 1, 2, 3):
        path = worded(f"words {seed}", seed=seed)
        found = save(new_robot(str(path), "same"), path.parent)
        about = json.loads(found[0].read_text())
        assert "-0.0," not in found[0].read_text()
        assert about.pop("written_in") == str(path.parent)
        written.append((about, found[1].read_text()))
    assert written[0] == written[1] == written[2] == written[3]
    assert written[0][0]["model"] == "worded.xml"


def test_the_range_of_an_ankle_ends_the_bend_of_its_legs(worded):
    """Legs as bent as the biped's need 0.505 rad at the ankle where thigh and shank are equal: its cosine."""
    path = worded("stiff")
    plain = new_robot(str(path), "plain").file.com_height
    path.write_text(path.read_text().replace('range="-0.8 0.8"', 'range="-0.3 0.3"'))
    stiff = new_robot(str(path), "stiff").file.com_height
    straight = plain + 0.7 * (1.0 - 0.875)
    assert straight - 0.7 * (1.0 - math.cos(0.3)) < stiff < straight


def test_rows_rest_on_all_files_of_a_robot(worded, tmp_path):
    """Robot file, model and preset; of a registered id too; not on where they lie."""
    path = worded("rows")
    robot, preset = save(new_robot(str(path), "rows"), path.parent)
    digests = [preset_digest(str(robot))]
    moved = tmp_path / "mov@ed [1]"
    path.parent.rename(moved)
    robot, preset, path = (moved / one.name for one in (robot, preset, path))
    assert preset_digest(str(robot)) == digests[0]
    ids = register_robot("Rows", str(robot))
    try:
        assert preset_digest(ids[0]) == digests[0]
        for file, old, new in (
            (path, 'mass="20"', 'mass="21"'), (preset, '"made_for"', '"made_for"'),
            (robot, '"fixed": {}', '"fixed":{}'), (robot, '"about": "', '"about": "My '),
            (preset, '"by": "', '"by": "my '),
        ):  # fmt: skip
            file.write_text(file.read_text().replace(old, new))
            digests.append(preset_digest(ids[0]))
    finally:
        for env_id in ids:
            gym.registry.pop(env_id)
    values = [one["robot_sha256"] for one in digests]
    assert values[1] != values[0]
    assert values[2] == values[3] == values[1]  # the same content, said the same or in other words
    assert len({values[3], values[4], values[5]}) == 3


def test_a_robot_made_in_python_is_known_by_its_compiled_model():
    heavy = weaker(0.5).description
    digests = [robot_digest(one) for one in (ROBOT, heavy, replace(ROBOT, com_height=0.79))]
    assert len(set(digests)) == 3
    assert robot_digest(replace(ROBOT)) == digests[0]


@pytest.mark.parametrize("words", [
    {"scene": '<body name="ball" pos="2 0 1"><freejoint/><geom size=".1"/></body>'},
    {"root": '<joint name="rootx" type="slide"/><joint name="rooty" axis="0 1 0"/>'},
    {"after": '<equality><weld name="crane" body1="trunk"/></equality>'},
    {"after": "<broken"},
])  # fmt: skip
def test_what_cannot_be_a_robot_is_one_line_and_bad_input(worded, capsys, words):
    assert main(["robot", "new", str(worded("bad", **words))]) == 2
    told = capsys.readouterr()
    assert told.err.count("\n") == 1
    assert told.out == ""


MESH = '<asset><mesh name="m" file="none.stl"/></asset><worldbody>'


def in_millimetres(said: re.Match) -> str:
    return f'{said[1]}="{" ".join(str(1e3 * float(one)) for one in said[2].split())}"'


@pytest.mark.parametrize(("old", "new", "message"), [
    ("<worldbody>", MESH, "MuJoCo cannot compile the model {}: Error: Error opening file 'none.stl'"),
    (r'(pos|size|fromto)="(.*?)"', in_millimetres,
     "the CoM of robot 'mine' is 812 m over its soles, it must be at most 10 m: is its model in "
     "millimetres?"),
])  # fmt: skip
def test_a_model_without_its_meshes_or_in_millimetres_is_refused(worded, old, new, message):
    path = worded("mine")
    path.write_text(re.sub(old, new, path.read_text()))
    with pytest.raises(InvalidValueError) as refused:
        new_robot(str(path), "mine")
    assert str(refused.value) == message.format(repr(str(path)))


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    path = tmp_path_factory.mktemp("mine") / "mine.xml"
    path.write_text(spec().to_xml(), encoding="utf-8")
    return new_robot(str(path), "mine")


@pytest.mark.parametrize(("taken", "reason"), [
    ("out", "its folder is a file"), ("out/mine.robot.json/x", "Is a directory"),
    ("out/mine.preset.json/x", "Is a directory"),
])  # fmt: skip
def test_where_nothing_can_be_written_nothing_is(mine, tmp_path, taken, reason):
    place = tmp_path / taken
    place.parent.mkdir(parents=True, exist_ok=True)
    place.touch()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InvalidValueError, match=rf"^can't write to '.*mine\..*\.json': {reason}$"):
        save(mine, tmp_path / "out")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_folder_is_no_model(capsys):
    assert main(["robot", "new", "."]) == 2
    assert capsys.readouterr().err == "push-recovery: error: there is no model '.'\n"


def test_what_leans_over_the_hips_is_pelvis_and_trunk_about_the_axis_across():
    """Of the model's file: hips 0.05 m below the pelvis; its CoM 0.02, the trunk's 0.08 + 0.18 m above it."""
    wanted = 0.11 + 16.0 * 0.07**2 + 7.0 + 30.0 * 0.31**2
    assert tools.leaning_inertia(biped()) == pytest.approx(wanted, rel=1e-6)
