"""Somebody else's robot is what MuJoCo compiles, and nothing of its file reaches the parts that are added."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.biped.model_errors import altered_model
from push_recovery.envs.robots.adapt import description_of
from push_recovery.envs.robots.compiled_robot import CompiledRobot
from push_recovery.envs.robots.robot_file import Motor, RobotFile, Sole, make_plan
from push_recovery.envs.robots.source_model import read_source
from push_recovery.envs.scenario.model_errors import ModelErrors

from .wordings import LEGS, PARTS, Wording

SOLES = (Sole((0.03, 0.0, -0.06), (0.2, 0.1)),) * 2
NAMES = {"names", "name", "paths", "text_data", "signature"}  # fields of names and of their places


@pytest.fixture
def file_of(tmp_path):
    """Makes a robot file of a text of MJCF."""

    def made(text, name="worded", motors=(), fixed=()):
        path = tmp_path / f"{name}.xml"
        path.write_text(text, encoding="utf-8")
        plan = make_plan("pelvis", "trunk", LEGS, bend=(0.0, 0.0, -0.35, 0.7, -0.35, 0.0))
        return RobotFile(name, str(path), plan, SOLES, motors, fixed, 0.7, "biped")

    return made


@pytest.fixture
def robot_of(file_of):
    return lambda *words, **parts: CompiledRobot(description_of(file_of(*words, **parts)))


@pytest.fixture
def plain(robot_of):
    return robot_of(Wording().text()).model


def fields(model):
    """All arrays of a model but those of names."""
    found = {name: getattr(model, name) for name in dir(model) if name not in NAMES and name[:5] != "name_"}
    return {name: value for name, value in found.items() if isinstance(value, np.ndarray)}


def test_the_plain_robot_is_the_one_that_was_said(plain):
    for side in ("left", "right"):
        for part, (place, mass, joints, bound, torque) in PARTS.items():
            body = plain.body(f"{side}_{part}")
            assert body.mass[0] == mass
            assert body.pos[2] == place[2]
            for joint in joints:
                motor = plain.actuator(f"{side}_{joint}")
                assert motor.forcerange.tolist() == [-torque, torque]
                assert plain.joint(f"{side}_{joint}").range[1] == bound
    assert set(plain.dof_armature[6:]) == {0.02}


@pytest.mark.parametrize("seed", range(8))
def test_one_robot_in_other_words_is_the_same_one(robot_of, plain, seed):
    """To rounding, since turns by 0.7 rad and back are no identity; the same words give the same bits."""
    words = Wording(seed).text()
    other, again = robot_of(words).model, robot_of(words, name="again").model
    for name, value in fields(plain).items():
        found = getattr(other, name)
        np.testing.assert_array_equal(found, getattr(again, name))
        if "quat" in name:  # two quaternions are one attitude
            found, value = (np.abs(one @ np.array(one).T) if one.ndim == 2 else one for one in (found, value))
        np.testing.assert_allclose(found, value, rtol=1e-12, atol=1e-12, err_msg=name)


def moving(model):
    data, rng = mujoco.MjData(model), np.random.default_rng(5)
    data.qpos[7:], data.qvel[:] = rng.uniform(-0.6, 0.6, model.nq - 7), rng.uniform(-1.0, 1.0, model.nv)
    mujoco.mj_forward(model, data)
    return data


@pytest.mark.parametrize("seed", range(2))
def test_it_moves_as_its_own_model_does(robot_of, tmp_path, seed):
    """With references, frames and turned axes: places of bodies and mass matrix at some joint angles."""
    ours = moving(robot_of(Wording(seed).text()).model)
    whole = mujoco.MjModel.from_xml_path(str(tmp_path / "worded.xml"))
    whole.dof_damping[:], whole.opt.timestep = 0.0, 0.002
    theirs = moving(whole)
    for body in range(1, whole.nbody):
        name = whole.body(body).name
        np.testing.assert_allclose(ours.body(name).xpos, theirs.body(name).xpos, atol=1e-12)
    np.testing.assert_allclose(ours.M, theirs.M, atol=1e-12)


BOX = (0.05, 0.04, 0.1)  # half sizes of a trunk of 20 kg
EXPLICIT = '<inertial mass="20" pos="0 0 .2" diaginertia=".8 .7 .3"/>'


@pytest.mark.parametrize("rule", ["auto", "true"])
def test_inertias_of_shapes_are_the_shapes(robot_of, rule):
    """m/3 (b^2 + c^2) of a box; with the rule true above what bodies say, and shapes for the eye count."""
    box = f'<geom type="box" size="{" ".join(map(str, BOX))}" pos="0 0 .2" mass="20" group="2" contype="0"/>'
    words = Wording().text().replace(EXPLICIT, box if rule == "auto" else EXPLICIT + box)
    words = words.replace('type="capsule"', 'type="capsule" mass="0"')
    if rule == "true":
        other = '<geom type="box" size=".1 .1 .1" mass="4" group="2"/>'
        words = words.replace("<inertial mass", f"{other}<inertial mass")
    model = robot_of(words.replace("<compiler ", f'<compiler inertiafromgeom="{rule}" ')).model
    trunk, a, b, c = model.body("trunk"), *BOX
    more = 4.0 if rule == "true" else 0.0
    assert trunk.mass[0] == pytest.approx(20.0 + more)
    if rule == "auto":
        wanted = 20.0 / 3.0 * np.array([a * a + b * b, a * a + c * c, b * b + c * c])
        np.testing.assert_allclose(np.sort(trunk.inertia), np.sort(wanted), rtol=1e-12)
        np.testing.assert_allclose(trunk.ipos, (0.0, 0.0, 0.2), atol=1e-12)


@pytest.mark.parametrize(("rule", "mass"), [("true", 3.0), ("auto", 1.0), ("false", 1.0)])
def test_an_attached_model_has_its_own_rule_of_inertias(file_of, tmp_path, rule, mass):
    (tmp_path / "foot.xml").write_text(
        f'<mujoco><compiler inertiafromgeom="{rule}"/><worldbody><body name="pad">'
        '<inertial mass="1" pos="0 0 0" diaginertia=".01 .01 .01"/>'
        '<geom type="box" size=".1 .05 .01" mass="3"/></body></worldbody></mujoco>'
    )
    words = Wording(extra='<attach model="foot" prefix="own_" body="pad"/>').text()
    asset = '<asset><model name="foot" file="foot.xml"/></asset><worldbody>'
    source = read_source(file_of(words.replace("<worldbody>", asset)).model)
    assert source.model.body("own_pad").mass == mass


DEFAULTS = (
    '<geom contype="0" conaffinity="2" friction="3 1 1" condim="6" margin=".1" gap=".05" solref=".3 1"/>'
    '<joint armature="9" frictionloss="20" stiffness="8" margin=".3" solimplimit=".5 .6 .1"/>'
    '<pair condim="6" friction="5 5 1 1 1" solref=".5 1" solimp=".1 .2 .3" margin=".05" gap=".02"/>'
    '<site type="sphere" size=".5" group="1"/><motor gear="7" ctrlrange="-1 1"/><position kp="300"/>'
    '<general gear="3" gainprm="5" biastype="affine" biasprm="1 2 3" ctrlrange="-1 1" group="4"/>'
)
AFTER = (
    '<contact><exclude body1="pelvis" body2="trunk"/></contact><sensor><gyro site="hand"/></sensor>'
    '<actuator><position joint="left_knee" kp="9"/></actuator><option gravity="0 0 -3" integrator="RK4"/>'
    '<keyframe><key qpos="0 0 .5 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0"/></keyframe><size nuserdata="4"/>'
)
LOOKS = {"site_rgba", "site_group", "geom_rgba"}


@pytest.mark.parametrize("part", ["defaults", "after", "root", "weight", "scene"])
def test_nothing_of_the_file_reaches_the_robot_but_bodies_and_joints(robot_of, plain, part):
    """Default classes, contacts, sensors, actuators, options, a free joint that is damped, carried weight."""
    site = Wording(extra='<site name="hand"/>')
    words = {
        "defaults": Wording().text(defaults=DEFAULTS),
        "after": site.text(after=AFTER),
        "root": Wording().text(root='<joint name="left_load" type="free" damping="5" armature="3"/>'),
        "weight": Wording().text().replace("<body ", '<body gravcomp="1" '),
        "scene": Wording().text(scene='<geom name="floor" type="hfield" hfield="hills"/><light/>').replace(
            "<worldbody>", '<asset><hfield name="hills" nrow="3" ncol="3" size="1 1 1 1"/></asset><worldbody>'
        ),
    }  # fmt: skip
    assert words[part] != Wording().text()
    found = fields(robot_of(words[part]).model)
    for name, value in fields(plain).items():
        if name not in LOOKS:
            np.testing.assert_array_equal(found[name], value, err_msg=name)


OURS = (
    '<geom name="floor" size=".1"/><geom name="left_foot_sole" size=".1"/><geom name="left_shank_capsule" '
    'size=".1" material="pr_shell"/><site name="left_sole"/><site name="right_sole"/>'
)
ASSETS = (
    '<sensor><touch name="left_load" site="left_sole"/></sensor><asset><texture name="pr_floor" type="2d" '
    'builtin="flat" width="4" height="4"/><material name="pr_shell" texture="pr_floor" rgba="1 0 0 1"/>'
    '<material name="pr_floor"/></asset>'
)


PAINT = (
    '<asset><material name="red" rgba="1 0 0 1"/><texture name="dots" type="2d" builtin="flat" width="4" '
    'height="4"/></asset>'
)


@pytest.mark.parametrize("words", [
    Wording(extra='<site name="hand" material="red"/>').text(),
    Wording().text(scene='<light texture="dots" type="image"/>'),
])  # fmt: skip
def test_sites_and_lights_may_have_materials_and_textures(robot_of, plain, words):
    painted = words.replace("<worldbody>", f"{PAINT}<worldbody>")
    np.testing.assert_array_equal(robot_of(painted).model.body_mass, plain.body_mass)


CORNERS = "0 0 0 .1 0 0 0 .1 0 0 0 .1"
OBJ = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize("mesh", [f'vertex="{CORNERS}"', 'builtin="sphere" params="1"', "attached"])
def test_meshes_that_have_no_file_or_another_models_are_drawn_and_collide(robot_of, tmp_path, mesh):
    asset, shape = f'<mesh name="m" {mesh}/>', '<geom type="mesh" mesh="m" mass="0"/>'
    if mesh == "attached":
        (tmp_path / "arm" / "meshes").mkdir(parents=True)
        (tmp_path / "arm" / "meshes" / "m.obj").write_text(OBJ)
        (tmp_path / "arm" / "arm.xml").write_text(
            '<mujoco><compiler meshdir="meshes"/><asset><mesh name="m" file="m.obj"/></asset><worldbody>'
            f'<body name="arm"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>{shape}</body></worldbody>'
            "</mujoco>"
        )
        asset, shape = (
            '<model name="arm" file="arm/arm.xml"/>',
            '<attach model="arm" prefix="own_" body="arm"/>',
        )
    words = Wording(extra=shape).text()
    robot = robot_of(words.replace("<worldbody>", f"<asset>{asset}</asset><worldbody>"))
    assert robot.picture.nmesh == altered_model(robot, ModelErrors(collisions=True)).nmesh == 1


def test_names_of_the_model_may_be_those_of_added_parts(robot_of, plain):
    robot = robot_of(Wording(extra=OURS).text(after=ASSETS))
    for name in ("geom_type", "geom_size", "site_pos", "pair_geom1", "sensor_type"):
        np.testing.assert_array_equal(getattr(robot.model, name), getattr(plain, name))
    red = robot.picture.mat_rgba[:, 1] == 0.0
    assert robot.picture.ngeom > robot.model.ngeom + 3
    assert red.sum() == 1  # theirs, beside ours of the same name
    assert altered_model(robot, ModelErrors(collisions=True)).ngeom > robot.model.ngeom


def test_joints_and_bodies_may_have_any_names(file_of, plain):
    words = Wording().text().replace('"left_knee"', '"floor [1]*"').replace('"left_shank"', '"root"')
    file = file_of(words)
    legs = [[*LEGS[0][:3], "floor [1]*", *LEGS[0][4:]], LEGS[1]]
    named = replace(file, plan=make_plan("pelvis", "trunk", legs, bend=file.plan.bend))
    model = CompiledRobot(description_of(named)).model
    assert model.body("root").mass[0] == plain.body("left_shank").mass[0]
    assert model.actuator("floor [1]*").forcerange[1] == 200.0


@pytest.mark.parametrize(
    ("said", "torque"),
    [
        ('<motor joint="left_knee" ctrlrange="-2 2" gear="30"/>', 60.0),
        ('<motor joint="left_knee" ctrlrange="-2 2" gear="-30"/>', 60.0),
        ('<general joint="left_knee" gainprm="25" ctrlrange="-2 2"/>', 50.0),
        ('<position joint="left_knee" kp="5" forcerange="-40 40" gear="2"/>', 80.0),
        ('<position joint="left_knee" kp="5" ctrlrange="-1 1"/>', 200.0),  # the joint's own bound
        ('<motor joint="left_knee" forcerange="-500 500"/>', 200.0),
        ('<motor jointinparent="left_knee" forcerange="-40 40"/>', 40.0),
        ('<motor joint="left_knee" gear="88" ctrlrange="-1 1" forcerange="-88 88"/>', 88.0),
        ('<motor joint="left_knee" ctrlrange="-50 50" forcerange="-100 100"/>', 50.0),
        ('<motor joint="left_knee" ctrlrange="-90 30"/>', 30.0),  # both ways
        ('<motor joint="left_knee" ctrlrange="0 70"/><motor joint="left_knee" ctrlrange="-45 0"/>', 45.0),
    ],
)
def test_the_largest_torque_is_what_joint_and_actuators_let_through(file_of, said, torque):
    source = read_source(file_of(Wording().text(after=f"<actuator>{said}</actuator>")).model)
    assert source.torques["left_knee"] == torque
    assert source.torques["right_knee"] == 200.0


def test_rotors_of_motors_add_to_the_armature_of_their_joint(robot_of, tmp_path):
    """J + gear^2 J_m, as MuJoCo has it on the diagonal of the mass matrix."""
    motor = '<motor joint="left_knee" gear="3" ctrlrange="-100 100" armature=".05"/>'
    model = robot_of(Wording().text(after=f"<actuator>{motor}</actuator>")).model
    assert model.joint("left_knee").armature[0] == pytest.approx(0.02 + 9.0 * 0.05)
    assert model.joint("right_knee").armature[0] == 0.02
    whole = mujoco.MjModel.from_xml_path(str(tmp_path / "worded.xml"))
    ours, theirs = (one.joint("left_knee").M0[0] for one in (model, whole))
    assert ours == pytest.approx(theirs, rel=1e-9)


@pytest.mark.parametrize(("old", "new", "message"), [
    ('mass="20"', 'mass="nan"', "mass of body 'trunk' in the model {} must be finite, got nan"),
    ('mass="20"', 'mass="inf"', "mass of body 'trunk' in the model {} must be finite, got inf"),
    ('pos="0 0 .1"', 'pos="0 0 nan"', "pos of body 'trunk' in the model {} must be finite, got 0 0 nan"),
    (".8 .7 .3", ".8 nan .3", "inertia of body 'trunk' in the model {} must be finite, got 0.8 nan 0.3"),
    ("-0.05 2.2", "nan nan", "range of joint 'left_knee' in the model {} must be finite, got nan nan"),
    ('armature=".02"', 'armature="inf"',
     "armature of joint 'left_hip_yaw' in the model {} must be finite, got inf"),
    ("</mujoco>", '<actuator><motor name="m" joint="left_knee" ctrlrange="nan nan"/></actuator></mujoco>',
     "ctrlrange of actuator 'm' in the model {} must be finite, got nan nan"),
])  # fmt: skip
def test_a_number_that_is_not_finite_is_refused_by_name(
    file_of, capfd, monkeypatch, tmp_path, old, new, message
):
    """And MuJoCo warns of it neither on the terminal nor in a log."""
    monkeypatch.chdir(tmp_path)
    file = file_of(Wording().text().replace(old, new))
    with pytest.raises(InvalidValueError) as refused:
        read_source(file.model)
    assert str(refused.value) == message.format(repr(file.model))
    assert capfd.readouterr() == ("", "")
    assert [path.name for path in tmp_path.iterdir()] == ["worded.xml"]


@pytest.mark.parametrize(("bounds", "limited", "found"), [
    ("-inf inf", False, (0.0, 0.0)), ("-.05 inf", True, (-0.05, np.finfo(float).max)),
])  # fmt: skip
def test_a_range_without_ends_is_none(robot_of, bounds, limited, found):
    model = robot_of(Wording().text().replace("-0.05 2.2", bounds)).model
    assert model.joint("left_knee").limited == limited
    assert tuple(model.joint("left_knee").range) == found


def test_an_infinite_torque_is_no_bound(file_of):
    words = Wording().text().replace('actuatorfrcrange="-200.0 200.0"', 'actuatorfrcrange="-inf inf"')
    motor = '<actuator><motor joint="left_knee" ctrlrange="-50 50"/></actuator></mujoco>'
    torques = read_source(file_of(words.replace("</mujoco>", motor)).model).torques
    assert torques["left_knee"] == 50.0
    assert "right_knee" not in torques


def test_what_mujoco_warns_of_is_not_told(file_of, recwarn):
    read_source(file_of(Wording().text().replace("<compiler ", '<compiler settotalmass="46" ')).model)
    assert not recwarn.list


def test_a_range_that_does_not_limit_is_none(file_of):
    free = ' limited="false" actuatorfrclimited="false" range='
    words = Wording().text().replace("<compiler ", '<compiler autolimits="false" ').replace(" range=", free)
    source = read_source(file_of(words).model)
    assert source.torques == {}
    assert all(not joint.range.any() for joint in source.rewritten().joints)


@pytest.mark.parametrize(("keys", "speeds"), [
    (("left_hip_[yaw]", "left_*"), [1.0, 2.0]),
    (("left_*", "left_hip_[yaw]"), [1.0, 2.0]),
    (("left_hip_?oll", "left_*"), [2.0, 1.0]),
])  # fmt: skip
def test_a_name_with_brackets_is_no_pattern(file_of, keys, speeds):
    """A key that is a joint's name is that joint's alone, wherever it stands."""
    words = Wording().text().replace('"left_hip_yaw"', '"left_hip_[yaw]"')
    file = file_of(words, motors=tuple((key, Motor(speed=2.0 if "*" in key else 1.0)) for key in keys))
    legs = [["left_hip_[yaw]", *LEGS[0][1:]], LEGS[1]]
    plan = make_plan("pelvis", "trunk", legs, bend=file.plan.bend)
    model = CompiledRobot(description_of(replace(file, plan=plan))).model
    assert [model.actuator(name).user[0] for name in ("left_hip_[yaw]", "left_hip_roll")] == speeds


def test_a_root_whose_axes_lie_is_turned_upright(robot_of, plain):
    """The pelvis described in axes with y up; all that hangs from it keeps its place in the world."""
    lying = '<body name="pelvis" pos="0 0 .86" euler="1.5707963267948966 0 0">'
    words = Wording().text()
    first, rest = words.split('<body name="pelvis" pos="0 0 .86">')
    inner, after = rest[: rest.rindex("</body></worldbody>")], rest[rest.rindex("</body></worldbody>") :]
    head, hanging = inner.split("<freejoint/>")
    head = head.replace(".08 .07 .06", ".08 .06 .07")  # its own inertia, in turned axes
    back = f'<frame euler="-1.5707963267948966 0 0">{hanging}</frame>'
    found = robot_of(first + lying + head + "<freejoint/>" + back + after).model
    np.testing.assert_allclose(moving(found).M, moving(plain).M, atol=1e-9)
    np.testing.assert_allclose(moving(found).xpos[1:], moving(plain).xpos[1:], atol=1e-9)


BALL = '<body name="ball" pos="2 0 .1"><freejoint/><geom size=".1"/></body>'
DOOR = (
    '<body name="door"><joint name="pin" axis="0 0 1"/><geom type="box" size=".02 .4 1" pos="2 0 1"/></body>'
)
TABLE = '<body name="table" pos="2 0 .4"><geom type="box" size=".5 .5 .02"/></body>'
TWO_SLIDES = '<joint name="x" type="slide"/><joint name="z" type="slide" axis="0 0 1"/>'
UNKNOWN_MESH = Wording(extra='<geom type="mesh" mesh="none"/>').text().replace(EXPLICIT, "")
ROPE = '<tendon><fixed name="ham"><joint joint="left_knee" coef="1"/></fixed></tendon>'


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (Wording().text(scene=BALL), r"holds 'ball', 'pelvis' side by side: it must hold one robot"),
        (Wording().text(scene=DOOR), r"holds 'door', 'pelvis' side by side"),
        (Wording().text(scene=TABLE), r"holds 'table', 'pelvis' side by side"),
        (Wording().text(root=TWO_SLIDES), r"^the robot's root 'pelvis' .* by 'x' \(slide\), 'z' \(slide\)"),
        (Wording().text(root='<joint name="b" type="ball"/>'), r"moves by 'b' \(ball\)"),
        (Wording().text().replace('name="left_knee" ', ""), r"^a joint of body 'left_shank' .* has no name"),
        (Wording().text().replace('<body name="left_shank"', "<body"), r"from 'left_thigh' .* has no name"),
        (Wording().text().replace('<body name="pelvis"', "<body"), r"^the robot's root in .* no name"),
        ("<mujoco/>", r"^there is no robot in the model"),
        (UNKNOWN_MESH, r"mesh 'none' not found"),
    ],
)  # fmt: skip
def test_what_is_no_robot_is_refused_in_one_line(file_of, words, message):
    with pytest.raises(InvalidValueError, match=message) as refused:
        read_source(file_of(words).model)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("after", "message"), [
    (ROPE, r"has the tendon 'ham' of left_knee: control knows chains of joints"),
    ('<equality><weld name="crane" body1="trunk"/></equality>', r"constraint \(weld\) 'crane': control"),
    ('<equality><joint joint1="left_knee" joint2="right_knee"/></equality>', r"of left_knee, right_knee:"),
])  # fmt: skip
def test_what_ties_bodies_is_refused_unless_it_is_fixed_or_off(robot_of, plain, after, message):
    with pytest.raises(InvalidValueError, match=message):
        robot_of(Wording().text(after=after))
    if "equality" in after:
        off = after.replace("/></equality>", ' active="false"/></equality>')
        np.testing.assert_array_equal(robot_of(Wording().text(after=off)).model.body_pos, plain.body_pos)


def test_floors_targets_and_shapes_for_the_eye_may_stand_beside_it(robot_of, plain):
    scene = (
        '<body name="ground"><geom type="plane" size="5 5 1"/></body><body name="target" mocap="true">'
        '<geom size=".1" contype="0" conaffinity="0"/></body><geom type="box" size="1 1 .1" pos="3 0 0"/>'
        f'<body name="house">{20 * """<body><geom size=".1" contype="0" conaffinity="0"/></body>"""}</body>'
    )
    np.testing.assert_array_equal(robot_of(Wording().text(scene=scene)).model.body_pos, plain.body_pos)


def test_a_long_chain_of_bodies_is_one_robot(robot_of, plain):
    chain = "".join(f'<body name="link {i}">' for i in range(450)) + 450 * "</body>"
    assert robot_of(Wording(extra=chain).text()).model.nbody == plain.nbody + 450


def test_a_slide_and_a_hinge_that_are_fixed_keep_their_place(robot_of, tmp_path):
    """At 0.03 m and 0.4 rad, in a row on one body, after a joint that stays."""
    joints = (
        '<joint name="turn" axis="1 0 0" actuatorfrcrange="-9 9"/>'
        '<joint name="reach" type="slide" axis="0 1 0" pos=".1 0 0"/>'
        '<joint name="bow" axis="0 1 0" pos="0 0 .1" ref=".1"/>'
    )
    words = Wording(extra=f'<body name="arm" pos=".1 .2 .3">{joints}<inertial mass="2" pos="0 0 0" '
                    'diaginertia=".01 .01 .01"/></body>').text()  # fmt: skip
    with pytest.raises(InvalidValueError, match=r"^joint 'reach' is a slide: it must be a hinge or be named"):
        robot_of(words)
    with pytest.raises(InvalidValueError, match=r"^joint 'turn' has no role in the BodyPlan"):
        robot_of(words, fixed=(("reach", 0.03), ("bow", 0.4)))
    fixed = (("turn", 0.2), ("reach", 0.03), ("bow", 0.4))
    ours = robot_of(words, fixed=fixed).model
    whole = mujoco.MjModel.from_xml_path(str(tmp_path / "worded.xml"))
    data, found = mujoco.MjData(whole), mujoco.MjData(ours)
    for name, angle in fixed:
        data.joint(name).qpos = angle
    for model, one in ((whole, data), (ours, found)):
        one.qpos[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
        mujoco.mj_kinematics(model, one)
    np.testing.assert_allclose(found.body("arm").xpos, data.body("arm").xpos, atol=1e-12)
    np.testing.assert_allclose(found.body("arm").xmat, data.body("arm").xmat, atol=1e-12)


def test_a_shank_reaches_its_ankle_through_bodies_without_joints(robot_of, plain):
    words = Wording().text()
    foot = words.index('<body name="left_foot"')
    end = words.index("</body></body></body><body", foot)
    frame = '<body name="weld" pos=".01 0 -.1" quat="0.8 0.6 0 0">'
    straight, back = 'pos="0.0 0.0 -0.35" quat="1.0 0.0 0.0 0.0"', 'pos="-.01 -.24 -.07" quat="0.8 -0.6 0 0"'
    turned = words[foot:end].replace(straight, back)
    model = robot_of(words[:foot] + frame + turned + "</body>" + words[end:]).model
    capsules = [one.geom("left_shank_capsule") for one in (model, plain)]
    np.testing.assert_allclose(capsules[0].pos, capsules[1].pos, atol=1e-12)
    np.testing.assert_allclose(capsules[0].size, capsules[1].size, atol=1e-12)


@pytest.mark.parametrize(("bend", "signs"), [(0.7, [1.0, -1.0]), (-0.7, [-1.0, 1.0]), (0.0, [1.0, 1.0])])
def test_a_knee_without_a_range_bends_as_the_plan_says(file_of, bend, signs):
    """The right one turns about the opposite axis, so that its mirror image has the other sign."""
    words = Wording().text().replace('range="-0.05 2.2"', 'limited="false"')
    place = words.index('name="right_knee"')
    words = words[:place] + words[place:].replace("0.0 1.0 0.0", "0.0 -1.0 0.0", 1)
    file = file_of(words)
    plan = replace(file.plan, bend=(0.0, 0.0, -0.35, bend, -0.35, 0.0))
    assert CompiledRobot(description_of(replace(file, plan=plan))).knee_bend.tolist() == signs


def test_a_joint_without_a_rotor_gets_one(robot_of):
    words = Wording().text().replace('armature=".02" ', "")
    assert set(robot_of(words).model.dof_armature[6:]) == {0.01}
