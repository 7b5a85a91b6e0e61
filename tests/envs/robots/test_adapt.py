"""A model of somebody else's becomes a robot: the biped, dressed up as one, is the biped again.

Shapes that collide: those that somebody else's model lets collide, and nothing that touches at rest.
"""

from dataclasses import replace
from importlib.util import find_spec

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.envs.biped.model_errors import altered_model
from push_recovery.envs.joint.full_body import driven, joint_names
from push_recovery.envs.robots.adapt import description_of
from push_recovery.envs.robots.biped import biped
from push_recovery.envs.robots.compiled_robot import CompiledRobot, compiled_robot
from push_recovery.envs.robots.description import robot_description
from push_recovery.envs.robots.model_files import PACKAGES
from push_recovery.envs.robots.robot_file import Sole
from push_recovery.envs.scenario.model_errors import ModelErrors


@pytest.fixture
def compiled(robot_file):
    return lambda *change, **fields: CompiledRobot(description_of(robot_file(*change, **fields)))


def moving(model):
    """The model in a posture that is not symmetric, and moving."""
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    data.qpos[7:], data.qvel[:] = rng.uniform(0.1, 0.4, model.nq - 7), rng.uniform(-1.0, 1.0, model.nv)
    mujoco.mj_forward(model, data)
    return data


def test_it_moves_as_the_biped_does(compiled):
    theirs, ours = compiled(), biped()
    found, wanted = moving(theirs.model), moving(ours.model)
    np.testing.assert_allclose(found.M, wanted.M, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.qfrc_bias, wanted.qfrc_bias, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(found.qfrc_passive, 0.0)
    np.testing.assert_allclose(theirs.motors, ours.motors)
    np.testing.assert_allclose(theirs.soles, ours.soles, atol=1e-12)
    assert theirs.ankle_height == pytest.approx(ours.ankle_height)
    assert theirs.half_sole == pytest.approx(ours.half_sole)
    assert theirs.leg_form == ours.leg_form
    assert theirs.model.npair == ours.model.npair
    assert theirs.model.opt.disableflags == ours.model.opt.disableflags


def test_it_stands_on_its_soles(compiled):
    theirs = compiled()
    data = mujoco.MjData(theirs.model)
    data.qpos[2] = (
        0.06 + 0.72 + 0.05 - 1e-4
    )  # sole, straight leg and hip below the pelvis, pressed down a little
    for _ in range(3):
        mujoco.mj_step(theirs.model, data)
    loads = data.sensordata[list(theirs.indices.loads)]
    assert (loads > 10.0).all()
    assert data.ncon == 8  # the corners of both soles


def test_a_foot_whose_axes_are_turned_is_turned_back(compiled, robot_file):
    """The foot's body is described in axes that `turn` takes to those of its sole."""
    half = 0.5 * 0.7
    turn = (np.cos(half), 0.0, np.sin(half), 0.0)  # 0.7 rad about y

    def turned(model):
        for side in ("left", "right"):
            foot = model.body(f"{side}_foot")
            back = np.array(turn) * [1.0, -1.0, -1.0, -1.0]
            foot.quat = back  # the sole's axes are what `turn` makes of these
            for part in (*foot.geoms, *foot.sites):
                place = np.empty(3)
                mujoco.mju_rotVecQuat(place, np.array(part.pos), np.array(turn))
                part.pos = place
            for joint in foot.joints:
                axis = np.empty(3)
                mujoco.mju_rotVecQuat(axis, np.array(joint.axis), np.array(turn))
                joint.axis = axis
            place, quat = np.empty(3), np.empty(4)
            mujoco.mju_rotVecQuat(place, np.array(foot.ipos), np.array(turn))
            mujoco.mju_mulQuat(quat, np.array(turn), np.array(foot.iquat))
            foot.ipos, foot.iquat = place, quat

    plain, centre = robot_file().soles[0], np.empty(3)
    mujoco.mju_rotVecQuat(centre, np.array(plain.centre), np.array(turn))
    sole = Sole(tuple(centre), plain.size, turn)
    theirs = compiled(turned, soles=(sole, sole))
    np.testing.assert_allclose(theirs.soles, biped().soles, atol=1e-6)
    np.testing.assert_allclose(moving(theirs.model).M, moving(biped().model).M, atol=1e-5)


def test_a_fixed_joint_keeps_its_angle(compiled, robot_file, tmp_path):
    angle = 0.4

    def change(model):
        model.joint("waist_roll").pos = [0.03, 0.02, 0.05]

    plan = replace(robot_file().plan, waist=("waist_pitch", None))
    theirs = compiled(change, fixed=(("waist_roll", angle),), plan=plan)
    whole = mujoco.MjModel.from_xml_path(str(tmp_path / "theirs.xml"))
    wanted, found = mujoco.MjData(whole), mujoco.MjData(theirs.model)
    wanted.joint("waist_roll").qpos = angle
    for name in ("waist_pitch", "left_knee"):
        wanted.joint(name).qpos = found.joint(name).qpos = 0.3
    for model, data in ((whole, wanted), (theirs.model, found)):
        mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(found.body("trunk").xpos, wanted.body("trunk").xpos, atol=1e-12)
    np.testing.assert_allclose(found.body("trunk").xmat, wanted.body("trunk").xmat, atol=1e-12)


def test_what_no_motor_can_drive_stays_fixed_where_all_joints_are_driven(robot_file):
    """A slide, and a hinge without a motor; the waist's roll, which has one, is driven."""

    def change(model):
        for name, kind in (("slider", mujoco.mjtJoint.mjJNT_SLIDE), ("wheel", mujoco.mjtJoint.mjJNT_HINGE)):
            body = model.body("trunk").add_body(name=f"{name}_body")
            body.add_joint(name=name, type=kind, limited=mujoco.mjtLimited.mjLIMITED_FALSE)
            body.add_geom(size=[0.01, 0.0, 0.0], mass=0.1)

    plan = replace(robot_file().plan, waist=("waist_pitch", None))
    fixed = ("slider", 0.0), ("wheel", 0.0), ("waist_roll", 0.2)
    whole = driven(description_of(robot_file(change, fixed=fixed, plan=plan)))
    names = joint_names(CompiledRobot(whole))
    assert "waist_roll" in names
    assert not {"slider", "wheel"} & set(names)


def test_torques_that_the_file_leaves_out_are_the_models(compiled):
    def limited(model):
        for actuator in model.actuators:
            actuator.forcelimited, actuator.forcerange = True, [-77.0, 77.0]

    theirs = compiled(limited, motors=())
    assert set(theirs.motors[0]) == {77.0}
    assert set(theirs.model.dof_armature[6:]) == {0.3}


def test_what_cannot_be_adapted_is_refused_with_a_reason(compiled):
    def unlimited(model):
        for actuator in model.actuators:
            actuator.forcelimited, actuator.forcerange = False, [0.0, 0.0]

    def closed(model):
        model.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT,
            name1="left_knee",
            name2="right_knee",
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
        )

    with pytest.raises(InvalidValueError, match=r"^joint '\w+' has no largest torque: name it in 'motors'$"):
        compiled(unlimited, motors=())
    with pytest.raises(InvalidValueError, match=r"^a robot with equality constraints"):
        compiled(closed)
    with pytest.raises(UnknownNameError, match=r"^unknown fixed joint 'tail'"):
        compiled(fixed=(("tail", 0.0),))


def test_it_is_drawn_with_the_shapes_of_its_model(compiled):
    theirs = compiled()
    assert theirs.picture.nq == theirs.model.nq
    assert theirs.picture.ngeom > theirs.model.ngeom
    assert not theirs.picture.geom_contype.any()
    np.testing.assert_allclose(theirs.picture.body_mass, theirs.model.body_mass)


COLLIDING = ModelErrors(collisions=True)
needs_robots = pytest.mark.skipif(
    any(find_spec(name) is None for name in PACKAGES), reason="needs pip install 'push-recovery[robots]'"
)


@pytest.fixture
def colliding(robot_file):
    def made(change=lambda model: None, **fields):
        robot = CompiledRobot(description_of(robot_file(change, **fields)))
        return robot, altered_model(robot, COLLIDING)

    return made


def meetings(model, angles, height=1.5):
    """Pairs of bodies that touch with joints at angles [rad], the pelvis at a height [m]."""
    data = mujoco.MjData(model)
    data.qpos[2], data.qpos[7 : 7 + len(angles)] = height, angles
    mujoco.mj_forward(model, data)
    bodies = model.geom_bodyid[data.contact.geom]
    return {tuple(sorted(model.body(body).name for body in pair)) for pair in bodies}


def test_its_own_shapes_meet_where_those_of_the_biped_do(colliding):
    _, theirs = colliding()
    ours, rng, seen = altered_model(biped(), COLLIDING), np.random.default_rng(3), set()
    for _ in range(40):
        angles, height = rng.uniform(-1.2, 1.2, 14), rng.uniform(0.3, 1.2)
        ours_met, theirs_met = (  # without feet, whose soles are boxes of their own
            {pair for pair in meetings(model, angles, height) if not any("foot" in body for body in pair)}
            for model in (ours, theirs)
        )
        assert theirs_met == ours_met
        seen |= ours_met
    assert len(seen) > 8  # legs, arms, trunk and floor


def test_masses_and_joints_stay(colliding):
    robot, solid = colliding()
    np.testing.assert_array_equal(solid.body_mass, robot.model.body_mass)
    np.testing.assert_allclose(solid.body_inertia, robot.model.body_inertia, rtol=1e-12)
    np.testing.assert_array_equal(solid.jnt_range, robot.model.jnt_range)
    assert solid.ngeom > robot.model.ngeom


def ball(model, body, y, bit=1):
    """A ball of 6 cm beside a body's origin."""
    model.body(body).add_geom(
        name=f"{body}_ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.06, 0, 0], pos=[0.0, y, 0.0],
        contype=bit, conaffinity=bit, mass=0.0,
    )  # fmt: skip


def test_shapes_that_touch_at_rest_never_meet(colliding):
    """Hips are 20 cm apart, so balls 5 cm inside of each overlap by 2 cm, and balls 3 cm inside do not.

    A foot never meets its own shank, whatever touches at rest.
    """
    own = [("left_shank", "left_foot"), ("right_shank", "right_foot")]
    for inside, excluded in ((0.05, [("left_thigh", "right_thigh")]), (0.03, [])):

        def change(model, inside=inside):
            ball(model, "left_thigh", -inside)
            ball(model, "right_thigh", inside)

        _, solid = colliding(change)
        pairs = [(pair >> 16, pair & 0xFFFF) for pair in solid.exclude_signature]
        assert [tuple(solid.body(body).name for body in pair) for pair in pairs] == excluded + own
        assert not meetings(solid, np.zeros(14))
        crossed = np.zeros(14)
        for joint, angle in (("left_hip_roll", -0.5), ("right_hip_roll", 0.5)):
            crossed[solid.joint(joint).qposadr[0] - 7] = angle
        assert (("left_thigh", "right_thigh") in meetings(solid, crossed)) == (not excluded)


def test_what_is_only_looked_at_does_not_collide(colliding):
    def change(model):
        ball(model, "trunk", 1.0, bit=0)

    robot, solid = colliding(change)
    assert all(solid.geom(i).name != "trunk_ball" for i in range(solid.ngeom))
    assert any(robot.picture.geom(i).name == "trunk_ball" for i in range(robot.picture.ngeom))


def test_what_collides_by_a_pair_alone_does(colliding):
    def change(model):
        ball(model, "trunk", 1.0, bit=0)
        model.add_pair(geomname1="trunk_ball", geomname2="floor")

    _, solid = colliding(change)
    assert solid.geom("trunk_ball").contype[0] == 1


@needs_robots
@pytest.mark.parametrize(
    ("name", "thighs", "hips"),
    [
        ("g1", ("left_hip_yaw_link", "right_hip_yaw_link"), ("left_hip_roll_joint", "right_hip_roll_joint")),
        ("t1", ("Hip_Yaw_Left", "Hip_Yaw_Right"), ("Left_Hip_Roll", "Right_Hip_Roll")),
        ("jvrc1", ("L_HIP_Y_S", "R_HIP_Y_S"), ("L_HIP_R", "R_HIP_R")),
    ],
)
def test_thighs_of_robots_that_exist_meet_when_legs_cross(name, thighs, hips):
    """In the reference posture nothing meets; without the profile's collisions thighs never do."""
    body = compiled_robot(robot_description(name))
    solid, stance = altered_model(body, COLLIDING), body.in_reference_posture().qpos.copy()
    assert solid is not None
    crossed = stance.copy()
    for joint, angle in zip(hips, (-0.6, 0.6), strict=True):
        crossed[body.model.joint(joint).qposadr[0]] += angle
    pair = tuple(sorted(thighs))
    assert not meetings(solid, stance[7:])
    assert pair in meetings(solid, crossed[7:])
    assert pair not in meetings(body.model, crossed[7:])
    assert set(range(solid.nmesh)) <= set(solid.geom_dataid.tolist())  # no mesh that nothing collides with


def test_a_shank_is_a_capsule_over_the_middle_eight_tenths_between_knee_and_ankle(compiled):
    """0.36 m: from 0.036 to 0.324 m below the knee, 0.08 x 0.36 m thick."""
    for side in ("left", "right"):
        capsule = compiled().model.geom(f"{side}_shank_capsule")
        assert capsule.size[:2] == pytest.approx([0.0288, 0.144])
        assert capsule.pos == pytest.approx([0.0, 0.0, -0.18])


def test_the_ankle_is_as_high_over_a_leaning_sole_as_across_it(compiled):
    turn, centre = (np.cos(0.15), 0.0, np.sin(0.15), 0.0), np.empty(3)  # 0.3 rad about y
    mujoco.mju_rotVecQuat(centre, np.array([0.0, 0.0, -0.06]), np.array(turn))
    sole = Sole(tuple(centre), (0.2, 0.1), turn)
    assert compiled(soles=(sole, sole)).ankle_height == pytest.approx(0.06)


def test_its_contacts_stops_and_physics_are_the_bipeds(compiled):
    theirs, ours = compiled().model, biped().model
    for name in ("pair_friction", "pair_solref", "pair_solimp", "pair_dim", "jnt_solref"):
        np.testing.assert_array_equal(getattr(theirs, name), getattr(ours, name), err_msg=name)
    for name in ("integrator", "cone", "solver", "timestep"):
        assert getattr(theirs.opt, name) == getattr(ours.opt, name)


def test_a_shank_begins_at_a_knee_that_is_not_its_bodys_origin(compiled):
    """Knee 4 cm up, ankle 36 cm down: 0.4 m; the middle eight tenths of it."""

    def change(model):
        for side in ("left", "right"):
            model.joint(f"{side}_knee").pos = [0.0, 0.0, 0.04]

    capsule = compiled(change).model.geom("left_shank_capsule")
    assert capsule.pos == pytest.approx([0.0, 0.0, -0.16])
    assert capsule.size[:2] == pytest.approx([0.032, 0.16])


def test_a_shape_that_collides_keeps_its_friction(colliding):
    def change(model):
        ball(model, "trunk", 1.0)
        model.geom("trunk_ball").friction, model.geom("trunk_ball").condim = [0.3, 0.02, 0.003], 4

    shape = colliding(change)[1].geom("trunk_ball")
    assert (shape.friction.tolist(), shape.condim[0]) == ([0.3, 0.02, 0.003], 4)


def test_the_same_parts_meet_as_the_bipeds(compiled):
    """Soles with floor and each other, shanks with each other, a sole with the other leg's shank."""

    def met(model, names):
        found = set()
        for pair in zip(model.pair_geom1, model.pair_geom2, strict=True):
            called = [model.geom(int(geom)).name for geom in pair]
            found.add(frozenset(names.get(name, name) for name in called))
        return found

    theirs = {f"{side}_foot": f"{side}_foot_sole" for side in ("left", "right")}
    theirs |= {f"{side}_shank": f"{side}_shank_capsule" for side in ("left", "right")}
    assert met(compiled().model, {}) == met(biped().model, theirs)
