"""The biped as somebody else's model: everything that the adaptor has to change is changed beforehand."""

from dataclasses import replace

import mujoco
import pytest
from push_recovery.envs.robots.biped import PLAN, spec
from push_recovery.envs.robots.robot_file import Motor, RobotFile, Sole, make_plan

MOTORS = (
    ("*_hip_yaw", Motor(100.0, 23.0, 0.01)),
    ("*_hip_roll", Motor(200.0, 23.0, 0.01)),
    ("*_hip_pitch", Motor(220.0, 23.0, 0.01)),
    ("*_knee", Motor(300.0, 14.0, 0.01)),
    ("*_ankle_pitch", Motor(150.0, 9.0, 0.01)),
    ("*_ankle_roll", Motor(100.0, 9.0, 0.01)),
    ("waist_*", Motor(150.0, 23.0, 0.01)),
)
SOLE = Sole((0.0, 0.0, -0.06), (0.20, 0.10))


def their_model(change=lambda model: None) -> str:
    """MJCF of the biped with position servos, damping, other armatures and shapes that collide."""
    model = spec()
    for joint in model.joints:
        if joint.type != mujoco.mjtJoint.mjJNT_FREE:
            joint.damping, joint.frictionloss, joint.armature = [7.0, 0.0, 0.0], 2.0, 0.3
    for actuator in model.actuators:
        actuator.set_to_position(kp=400.0)
    for geom in model.geoms:
        geom.contype = geom.conaffinity = 1
    change(model)
    return model.to_xml()


@pytest.fixture
def robot_file(tmp_path):
    """Makes a robot file of that model, which it writes to a folder of the test."""

    def made(change=lambda model: None, **fields) -> RobotFile:
        path = tmp_path / "theirs.xml"
        path.write_text(their_model(change), encoding="utf-8")
        plan = make_plan(PLAN.pelvis, PLAN.trunk, PLAN.legs, PLAN.waist, PLAN.bend)
        plain = RobotFile("theirs", str(path), plan, (SOLE, SOLE), MOTORS, (), 0.8, "biped")
        return replace(plain, **fields)

    return made
