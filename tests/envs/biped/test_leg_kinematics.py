import mujoco
import numpy as np
import pytest
from push_recovery.controllers.whole_body.kinematics import LEG_QPOS
from push_recovery.envs.biped.posture import LegGeometry, leg_geometry, leg_joints, level_leg
from push_recovery.envs.robots.biped import PLAN, biped, biped_model

THIGH, SHANK, ANKLE_HEIGHT, HIP_DROP, HIP_OFFSET = 0.36, 0.36, 0.06, 0.05, 0.10  # as biped.xml has them [m]
LEG = LegGeometry(THIGH, SHANK, ANKLE_HEIGHT, HIP_DROP, HIP_OFFSET)
SIDES = ("left", "right")


def pelvis_pose(data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    return data.body("pelvis").xpos, data.body("pelvis").xmat.reshape(3, 3)


def sole_pose(data: mujoco.MjData, leg: int) -> tuple[np.ndarray, np.ndarray]:
    site = data.site(PLAN.soles[leg])
    return site.xpos.copy(), site.xmat.reshape(3, 3).copy()


def hip(data: mujoco.MjData, leg: int) -> np.ndarray:
    return data.xanchor[data.model.joint(f"{SIDES[leg]}_hip_yaw").id]


def placed(rng: np.random.Generator, joints: np.ndarray) -> mujoco.MjData:
    """MuJoCo's forward kinematics of a tilted pelvis and both legs at `joints` (2, 6)."""
    data = mujoco.MjData(biped_model())
    quat = np.append(1.0, rng.normal(0.0, 0.3, 3))
    data.qpos[:3], data.qpos[3:7] = rng.normal(size=3), quat / np.linalg.norm(quat)
    for leg in range(2):
        data.qpos[LEG_QPOS[leg] : LEG_QPOS[leg] + 6] = joints[leg]
    mujoco.mj_kinematics(biped_model(), data)
    return data


def joint_ranges() -> np.ndarray:
    model = biped_model()
    names = [name for name in (model.joint(i).name for i in range(model.njnt)) if name.startswith("left_")]
    return np.array([model.joint(name).range for name in names])


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


def test_angles_invert_mujocos_forward_kinematics_over_the_joint_ranges():
    rng, ranges = np.random.default_rng(0), joint_ranges()
    for _ in range(100):
        joints = rng.uniform(ranges[:, 0], ranges[:, 1], (2, 6))
        data = placed(rng, joints)
        rotation = pelvis_pose(data)[1]
        for leg in range(2):
            found = leg_joints(hip(data, leg), rotation, *sole_pose(data, leg), LEG)
            data_again = mujoco.MjData(biped_model())
            data_again.qpos[:] = data.qpos
            data_again.qpos[LEG_QPOS[leg] : LEG_QPOS[leg] + 6] = found
            mujoco.mj_kinematics(biped_model(), data_again)
            for got, wanted in zip(sole_pose(data_again, leg), sole_pose(data, leg), strict=True):
                np.testing.assert_allclose(got, wanted, atol=1e-9)


def test_angles_are_unique_while_the_foot_hangs_below_the_hip():
    rng = np.random.default_rng(1)
    low = np.radians([-50.0, -40.0, -80.0, 5.0, -60.0, -40.0])
    high = np.radians([50.0, 40.0, 40.0, 100.0, 20.0, 40.0])
    for _ in range(100):
        joints = rng.uniform(low, high, (2, 6))
        data = placed(rng, joints)
        rotation = pelvis_pose(data)[1]
        for leg in range(2):
            found = leg_joints(hip(data, leg), rotation, *sole_pose(data, leg), LEG)
            np.testing.assert_allclose(found, joints[leg], atol=1e-8)


def test_a_foothold_out_of_reach_gives_a_straight_leg_that_points_at_it():
    rng = np.random.default_rng(2)
    for _ in range(20):
        target = np.array([*rng.uniform(-0.4, 0.4, 2), -1.2])
        joints = leg_joints(np.zeros(3), np.eye(3), target, np.eye(3), LEG)
        assert joints[3] == pytest.approx(0.0, abs=1e-6)
        data = mujoco.MjData(biped_model())
        data.qpos[2:4] = HIP_DROP, 1.0
        data.qpos[1] = -HIP_OFFSET
        data.qpos[LEG_QPOS[0] : LEG_QPOS[0] + 6] = joints
        mujoco.mj_kinematics(biped_model(), data)
        sole, rotation = sole_pose(data, 0)
        np.testing.assert_allclose(rotation, np.eye(3), atol=1e-9)
        ankle, wanted = sole + [0, 0, ANKLE_HEIGHT], target + [0, 0, ANKLE_HEIGHT]
        assert np.linalg.norm(ankle) == pytest.approx(THIGH + SHANK, abs=1e-9)
        np.testing.assert_allclose(np.cross(ankle, wanted), 0.0, atol=1e-6)


def test_mirrored_legs_have_mirrored_angles():
    rng = np.random.default_rng(3)
    flip = np.diag([1.0, -1.0, 1.0])
    joints = rng.uniform(joint_ranges()[:, 0], joint_ranges()[:, 1], (2, 6))
    data = placed(rng, joints)
    args = (hip(data, 0), pelvis_pose(data)[1], *sole_pose(data, 0))
    mirrored = leg_joints(flip @ args[0], flip @ args[1] @ flip, flip @ args[2], flip @ args[3] @ flip, LEG)
    np.testing.assert_allclose(mirrored, leg_joints(*args, LEG) * [-1, -1, 1, 1, 1, -1], atol=1e-9)


def test_a_level_foot_under_an_upright_pelvis_is_a_case_of_any_pose():
    rng = np.random.default_rng(4)
    for side in (1.0, -1.0):
        for _ in range(50):
            pelvis, joints = rng.uniform(-0.05, 0.05, 3) + [0.0, 0.0, 0.75], np.empty(6)
            sole = rng.uniform(-0.1, 0.1, 3) + [0.0, side * 0.1, 0.0]
            level_leg(pelvis, side, sole, LEG, joints)
            hip = pelvis + [0.0, side * HIP_OFFSET, -HIP_DROP]
            np.testing.assert_allclose(joints, leg_joints(hip, np.eye(3), sole, np.eye(3), LEG), atol=1e-12)
