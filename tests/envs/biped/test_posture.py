from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.whole_body.kinematics import (
    FOOT_BODY,
    LEG_DOF,
    LEG_JOINT,
    NU,
    NV,
    PELVIS,
    TRUNK,
    WAIST_DOF,
    WAIST_JOINT,
)
from push_recovery.envs.biped.core import BIPED
from push_recovery.envs.biped.posture import LegGeometry, leg_geometry, level_leg, posture
from push_recovery.envs.robots.biped import PLAN, biped, biped_model
from push_recovery.envs.scenario.model_errors import CONTROL_STEP

LEG_QPOS = (9, 15)  # first joint coordinate of the left and the right leg

THIGH, SHANK, ANKLE_HEIGHT, HIP_DROP, HIP_OFFSET = 0.36, 0.36, 0.06, 0.05, 0.10  # as biped.xml has them [m]
LEG = LegGeometry(THIGH, SHANK, ANKLE_HEIGHT, HIP_DROP, HIP_OFFSET)
SIDES = ("left", "right")


def soles_of(pelvis: np.ndarray, leg: int, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place and rotation of a sole by MuJoCo's forward kinematics, the pelvis upright."""
    data = mujoco.MjData(biped_model())
    data.qpos[:3], data.qpos[3:7] = pelvis, [1.0, 0.0, 0.0, 0.0]
    data.qpos[LEG_QPOS[leg] : LEG_QPOS[leg] + 6] = joints
    mujoco.mj_kinematics(biped_model(), data)
    site = data.site(PLAN.soles[leg])
    return site.xpos.copy(), site.xmat.reshape(3, 3).copy()


def level(pelvis: np.ndarray, leg: int, sole: np.ndarray) -> np.ndarray:
    joints = np.empty(6)
    level_leg(pelvis, 1.0 - 2.0 * leg, sole, LEG, joints)
    return joints


def test_lengths_are_the_models():
    model = biped_model()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        np.testing.assert_allclose(model.body(f"{side}_thigh").pos, [0, sign * HIP_OFFSET, -HIP_DROP])
        np.testing.assert_allclose(model.body(f"{side}_shank").pos, [0, 0, -THIGH])
        np.testing.assert_allclose(model.body(f"{side}_foot").pos, [0, 0, -SHANK])
        np.testing.assert_allclose(model.site(f"{side}_sole").pos, [0, 0, -ANKLE_HEIGHT])
        foot = model.geom(f"{side}_foot")
        assert foot.pos[2] - foot.size[2] == pytest.approx(-ANKLE_HEIGHT)
    assert leg_geometry(model, biped().indices) == LEG
    assert biped().ankle_height == ANKLE_HEIGHT
    np.testing.assert_array_equal(biped().soles, [[0.0, 0.0, -ANKLE_HEIGHT]] * 2)


@pytest.mark.parametrize("leg", [0, 1])
def test_a_leg_inverts_mujocos_forward_kinematics(leg):
    """The sole is flat where it is asked to be, and the mirrored leg has mirrored angles."""
    rng, flip = np.random.default_rng(4), np.array([1.0, -1.0, 1.0])
    for _ in range(50):
        pelvis = rng.uniform(-0.05, 0.05, 3) + [0.0, 0.0, 0.6]  # within reach
        sole = rng.uniform(-0.1, 0.1, 3) + [0.0, (1.0 - 2.0 * leg) * 0.1, 0.0]
        joints = level(pelvis, leg, sole)
        place, rotation = soles_of(pelvis, leg, joints)
        np.testing.assert_allclose(place, sole, atol=1e-9)
        np.testing.assert_allclose(rotation, np.eye(3), atol=1e-9)
        assert joints[0] == 0.0
        assert 0.0 < joints[3] < np.pi
        mirrored = level(flip * pelvis, 1 - leg, flip * sole)
        np.testing.assert_allclose(mirrored, joints * [1, -1, 1, 1, 1, -1], atol=1e-9)


def test_a_foothold_out_of_reach_gives_a_straight_leg_that_points_at_it():
    rng = np.random.default_rng(2)
    for _ in range(20):
        pelvis, target = np.array([0.0, -HIP_OFFSET, HIP_DROP]), np.array([*rng.uniform(-0.4, 0.4, 2), -1.2])
        joints = level(pelvis, 0, target)
        assert joints[3] == pytest.approx(0.0, abs=1e-6)
        sole, rotation = soles_of(pelvis, 0, joints)
        np.testing.assert_allclose(rotation, np.eye(3), atol=1e-9)
        ankle, wanted = sole + [0, 0, ANKLE_HEIGHT], target + [0, 0, ANKLE_HEIGHT]  # the hip is at the origin
        assert np.linalg.norm(ankle) == pytest.approx(THIGH + SHANK, abs=1e-9)
        np.testing.assert_allclose(np.cross(ankle, wanted), 0.0, atol=1e-6)


TORQUE_LIMITS = {
    "waist_pitch": 150, "waist_roll": 150, "hip_yaw": 100, "hip_roll": 200, "hip_pitch": 220, "knee": 300,
    "ankle_pitch": 150, "ankle_roll": 100,
}  # fmt: skip


def test_size():
    model = biped_model()
    assert (model.nq, model.nv, model.nu) == (21, NV, NU)
    assert model.body_mass.sum() == pytest.approx(BIPED.mass, abs=1e-12)
    assert model.opt.timestep == CONTROL_STEP == 0.002


def test_named_indices_are_the_models():
    model = biped_model()
    assert (model.body("pelvis").id, model.body("trunk").id) == (PELVIS, TRUNK)
    assert (model.joint("waist_pitch").id, model.joint("waist_pitch").dofadr[0]) == (WAIST_JOINT, WAIST_DOF)
    for leg, side in enumerate(("left", "right")):
        first = model.joint(f"{side}_hip_yaw")
        assert model.body(f"{side}_foot").id == FOOT_BODY[leg]
        assert (first.id, first.dofadr[0], first.qposadr[0]) == (LEG_JOINT[leg], LEG_DOF[leg], LEG_QPOS[leg])
        assert model.sensor(f"{side}_load").id == leg
    # torque i acts on degree of freedom 6 + i with gear 1
    np.testing.assert_array_equal(model.jnt_dofadr[model.actuator_trnid[:, 0]], 6 + np.arange(NU))
    np.testing.assert_array_equal(model.actuator_gear[:, 0], 1.0)


def test_torque_limits_are_on():
    model = biped_model()
    assert model.actuator_forcelimited.all()
    for i in range(NU):
        name = model.actuator(i).name
        limit = TORQUE_LIMITS[name.removeprefix("left_").removeprefix("right_")]
        np.testing.assert_array_equal(model.actuator_forcerange[i], [-limit, limit])
    np.testing.assert_array_equal(model.actuator_gainprm[:, 0], 1.0)
    assert not model.actuator_biasprm.any()


def test_nothing_props_the_robot_up():
    model = biped_model()
    assert model.neq == 0
    assert not model.body_gravcomp.any()
    assert model.ntendon == model.nmocap == 0
    assert not model.jnt_stiffness.any()
    assert not model.dof_damping.any()
    assert not model.dof_frictionloss.any()
    assert model.opt.density == model.opt.viscosity == 0
    np.testing.assert_allclose(model.opt.gravity, [0, 0, -9.81])
    disabled = ("mjDSBL_CONTACT", "mjDSBL_GRAVITY", "mjDSBL_LIMIT", "mjDSBL_ACTUATION", "mjDSBL_CONSTRAINT")
    assert not any(model.opt.disableflags & getattr(mujoco.mjtDisableBit, flag).value for flag in disabled)


def test_friction_is_at_most_0_9_and_contacts_push_only():
    model = biped_model()
    assert model.npair == 6
    assert model.pair_friction[:, :2].max() <= 0.9
    assert model.geom_friction[:, 0].max() <= 0.9
    assert not model.geom_contype.any()  # every contact is one of the pairs
    assert not model.geom_conaffinity.any()
    assert not model.pair_margin.any()
    assert not model.pair_gap.any()
    assert not model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE.value
    assert model.geom("floor").type[0] == mujoco.mjtGeom.mjGEOM_PLANE
    assert not model.geom("floor").pos.any()


def test_feet_and_trunk_are_those_the_planner_knows():
    model, data = biped_model(), mujoco.MjData(biped_model())
    np.testing.assert_allclose(2 * model.geom("left_foot").size[:2], [BIPED.foot_length, BIPED.foot_width])
    assert 2 * model.body("left_thigh").pos[1] == pytest.approx(BIPED.pelvis_width)
    mujoco.mj_forward(model, data)
    trunk = model.body("trunk")
    lever = np.linalg.norm(trunk.ipos)  # waist axes pass through the body's origin
    about_waist = trunk.inertia[:2] + trunk.mass * lever**2
    np.testing.assert_allclose(about_waist, BIPED.trunk_inertia, rtol=0.01)
    assert model.joint("waist_pitch").range[1] == pytest.approx(BIPED.trunk_angle_max)
    assert model.actuator("waist_pitch").forcerange[1] == BIPED.trunk_torque_max


def test_left_and_right_are_mirror_images():
    model, flip = biped_model(), np.array([1.0, -1.0, 1.0])
    for part in ("thigh", "shank", "foot"):
        left, right = model.body(f"left_{part}"), model.body(f"right_{part}")
        for name in ("mass", "inertia", "iquat"):
            np.testing.assert_array_equal(getattr(left, name), getattr(right, name))
        np.testing.assert_array_equal(left.pos, right.pos * flip)
        np.testing.assert_array_equal(left.ipos, right.ipos * flip)


def test_posture_has_the_com_asked_for_over_soles_at_rest():
    model, rng = biped_model(), np.random.default_rng(1)
    for _ in range(25):
        soles = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
        soles[:, :2] += rng.uniform(-0.1, 0.1, (2, 2))
        com, velocity = np.array([0, 0, 0.78]) + rng.uniform(-0.03, 0.03, 3), rng.normal(0, 0.5, 3)
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = posture(biped(), com, velocity, soles)
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        np.testing.assert_allclose(data.subtree_com[0], com, atol=1e-9)
        np.testing.assert_allclose(data.subtree_linvel[0], velocity, atol=1e-9)
        for leg in range(2):
            np.testing.assert_allclose(data.site(PLAN.soles[leg]).xpos, soles[leg], atol=1e-9)
            np.testing.assert_allclose(data.site(PLAN.soles[leg]).xmat.reshape(3, 3), np.eye(3), atol=1e-9)
            twist = np.empty(6)
            mujoco.mj_objectVelocity(
                model, data, mujoco.mjtObj.mjOBJ_SITE, model.site(PLAN.soles[leg]).id, twist, 0
            )
            np.testing.assert_allclose(twist, 0.0, atol=1e-9)
        for body in ("pelvis", "trunk"):
            np.testing.assert_allclose(data.body(body).xmat.reshape(3, 3), np.eye(3), atol=1e-12)
            np.testing.assert_allclose(data.body(body).cvel[:3], 0.0, atol=1e-12)


@pytest.mark.parametrize("lean", [(0.02, 0.0), (0.0, 0.02), (-0.03, 0.05)])
def test_pelvis_and_trunk_may_lean_over_the_same_soles(lean):
    """By one turn about the axis (-left, forward), whose matrix is that of Rodrigues."""
    model, data = biped_model(), mujoco.MjData(biped_model())
    soles, com = np.array([[0.05, 0.1, 0.0], [-0.05, -0.1, 0.0]]), np.array([0.01, 0.02, 0.78])
    data.qpos[:], data.qvel[:] = posture(biped(), com, np.array([0.3, 0.1, 0.0]), soles, lean)
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    np.testing.assert_allclose(data.subtree_com[0], com, atol=1e-9)
    np.testing.assert_allclose(data.subtree_linvel[0], [0.3, 0.1, 0.0], atol=1e-9)
    forward, left = lean
    cross = np.array([[0.0, 0.0, forward], [0.0, 0.0, left], [-forward, -left, 0.0]])
    angle = np.hypot(*lean)
    turn = np.eye(3) + np.sin(angle) / angle * cross + (1 - np.cos(angle)) / angle**2 * cross @ cross
    for body in ("pelvis", "trunk"):
        np.testing.assert_allclose(data.body(body).xmat.reshape(3, 3), turn, atol=1e-9)
    for leg in range(2):
        np.testing.assert_allclose(data.site(PLAN.soles[leg]).xpos, soles[leg], atol=1e-8)
        np.testing.assert_allclose(data.site(PLAN.soles[leg]).xmat.reshape(3, 3), np.eye(3), atol=1e-8)


def draw_posture(rng):
    soles = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
    soles[:, :2] += rng.uniform(-0.1, 0.1, (2, 2))
    return np.array([0.0, 0.0, 0.78]) + rng.uniform(-0.03, 0.03, 3), rng.normal(0.0, 0.5, 3), soles


def test_all_corners_of_both_soles_touch_the_floor():
    model, rng = biped_model(), np.random.default_rng(2)
    data, floor = mujoco.MjData(model), model.geom("floor").id
    for _ in range(50):
        data.qpos[:], data.qvel[:] = posture(biped(), *draw_posture(rng))
        mujoco.mj_forward(model, data)
        assert (data.contact.geom == floor).any(axis=1).sum() == 8


def test_posture_knows_nothing_of_the_postures_before_or_of_other_threads():
    cases = [draw_posture(np.random.default_rng(seed)) for seed in range(40)]
    alone = [posture(biped(), *case) for case in cases]
    with ThreadPoolExecutor(4) as pool:
        shared = list(pool.map(lambda case: posture(biped(), *case), reversed(cases)))
    for a, b in zip(alone, reversed(shared), strict=True):
        assert a[0].tobytes() == b[0].tobytes()
        assert a[1].tobytes() == b[1].tobytes()


def test_posture_out_of_reach_is_refused():
    with pytest.raises(InvalidValueError, match="no posture"):
        posture(
            biped(), np.array([0.0, 0.0, 1.1]), np.zeros(3), np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
        )
