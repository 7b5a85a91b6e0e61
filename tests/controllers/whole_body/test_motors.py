"""Motors: their torque-speed line, and that nothing passes it in a hard push."""

import math

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.limits import (
    FULL_TORQUE_SHARE,
    clip_torque,
    driving_share,
    write_torque_range,
)
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.biped import biped, biped_model
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Scenario

MODEL = biped_model()


@pytest.mark.parametrize(
    ("speed", "share"),
    [(-30.0, 1.0), (0.0, 1.0), (FULL_TORQUE_SHARE * 10.0, 1.0), (8.5, 0.5), (10.0, 0.0), (30.0, 0.0)],
)
def test_a_motor_drives_with_less_torque_near_its_free_speed(speed, share):
    assert driving_share(speed, 10.0) == pytest.approx(share, abs=1e-12)


@pytest.mark.parametrize(
    ("share_of_free_speed", "least", "largest"),
    [
        (-1.2, 0.0, 1.0),
        (-0.85, -0.5, 1.0),
        (-0.3, -1.0, 1.0),
        (0.3, -1.0, 1.0),
        (0.85, -1.0, 0.5),
        (1.2, -1.0, 0.0),
    ],
)
def test_the_range_of_torques_ends_where_a_motor_would_drive_too_fast(
    robot_in, share_of_free_speed, least, largest
):
    """Against its motion a motor has its full torque."""
    limits, qvel = biped().motors, np.zeros(MODEL.nv)
    qvel[6:] = share_of_free_speed * limits[1]
    core, _ = robot_in(MODEL.qpos0.copy(), qvel)
    found = np.empty((2, MODEL.nu))
    write_torque_range(core.physics, 0, limits, found)
    np.testing.assert_allclose(found, [least * limits[0], largest * limits[0]], atol=1e-9)
    torque = 1000.0 * np.where(np.arange(MODEL.nu) % 2, 1.0, -1.0)
    clip_torque(torque, found)
    np.testing.assert_array_equal(torque, np.where(np.arange(MODEL.nu) % 2, found[1], found[0]))


def test_every_motor_has_both_limits_and_left_and_right_the_same():
    limits = biped().motors
    names = [MODEL.actuator(i).name for i in range(MODEL.nu)]
    assert (limits > 0).all()
    for name, column in zip(names, limits.T, strict=True):
        twin = names.index(name.replace("left", "right"))
        np.testing.assert_array_equal(column, limits[:, twin])


def test_no_motor_gives_more_than_it_can_at_its_speed_in_a_hard_push():
    """Torques are for the speeds before the physics step, so these are kept from one step to the next."""
    episodes, policy = BipedEpisodes(1), make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
    core, (top, free_speed) = episodes.core, biped().motors
    push = polar_push(900.0, math.pi, 0.1, GaitEvent(2, "left", 0.0))
    episodes.begin(0, Scenario("hard", (push,)))
    speeds, used = core.physics.qvel[0, 6:].copy(), []

    def look() -> None:
        torque = core.physics.ctrl[0]
        share = [
            driving_share(v * np.sign(t), v0) for v, t, v0 in zip(speeds, torque, free_speed, strict=True)
        ]
        used.append(np.abs(torque) - top * share)
        speeds[:] = core.physics.qvel[0, 6:]

    core.after_physics_step = look
    for _ in range(200):
        episodes.step(policy.predict(core.observation)[0])
    assert np.max(used) <= 1e-9
    assert np.max(used, axis=0).max() > -1e-9  # some motor was at its limit
