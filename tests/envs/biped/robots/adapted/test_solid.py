"""Shapes that collide: those that somebody else's model lets collide, and nothing that touches at rest."""

from importlib.util import find_spec

import mujoco
import numpy as np
import pytest
from push_recovery.envs.biped.model_errors import altered_model
from push_recovery.envs.robots.adapt import PACKAGES, description_of
from push_recovery.envs.robots.biped import biped
from push_recovery.envs.robots.compiled_robot import CompiledRobot, compiled_robot
from push_recovery.envs.robots.description import robot_description
from push_recovery.envs.scenario.model_errors import ModelErrors

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
    """Hips are 20 cm apart, so balls 5 cm inside of each overlap by 2 cm, and balls 3 cm inside do not."""
    for inside, excluded in ((0.05, [("left_thigh", "right_thigh")]), (0.03, [])):

        def change(model, inside=inside):
            ball(model, "left_thigh", -inside)
            ball(model, "right_thigh", inside)

        _, solid = colliding(change)
        pairs = [(pair >> 16, pair & 0xFFFF) for pair in solid.exclude_signature]
        assert [tuple(solid.body(body).name for body in pair) for pair in pairs] == excluded
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
