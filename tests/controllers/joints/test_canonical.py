"""Canonical order and signs of the joints."""

import numpy as np
import pytest
from push_recovery.controllers.joint_control import (
    JOINT_NAMES,
    axial,
    joint_sign,
    own_joint,
    polar,
    to_canonical,
    to_own,
)
from push_recovery.envs.robots.biped import biped, biped_model

LEFT, RIGHT = 0, 1
OWN = [biped_model().actuator(i).name for i in range(biped_model().nu)]


@pytest.mark.parametrize(("stance", "sides"), [(LEFT, ("left", "right")), (RIGHT, ("right", "left"))])
def test_joints_are_named_by_the_role_of_their_leg(stance, sides):
    for c, name in enumerate(JOINT_NAMES):
        own = name.replace("stance", sides[0]).replace("swing", sides[1])
        assert OWN[own_joint(c, stance)] == own


def test_only_a_robot_on_its_left_foot_is_seen_in_a_mirror():
    """Yaw, roll and the waist's roll change their sign in a mirror, pitch and knee do not."""
    mirror = biped().mirror
    turned = [-1.0 if name.endswith(("yaw", "roll")) else 1.0 for name in JOINT_NAMES]
    for c, sign in enumerate(turned):
        assert joint_sign(mirror, own_joint(c, LEFT), LEFT) == sign
        assert joint_sign(mirror, own_joint(c, RIGHT), RIGHT) == 1.0


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
def test_there_and_back_is_where_it_was(stance):
    values = np.random.default_rng(0).normal(size=14)
    own, back = np.empty(14), np.empty(14)
    to_own(values, biped().mirror, stance, own)
    to_canonical(own, biped().mirror, stance, back)
    np.testing.assert_array_equal(back, values)
    assert (own != values).any()


def test_a_mirror_turns_velocities_aside_and_rates_about_the_axes_of_its_plane():
    velocity, rate, place = np.random.default_rng(1).normal(size=(3, 3))
    mirror = np.diag([1.0, -1.0, 1.0])
    np.testing.assert_array_equal(polar(-1.0, tuple(velocity)), mirror @ velocity)
    turned = np.cross(axial(-1.0, tuple(rate)), mirror @ place)  # the velocity of a mirrored point
    np.testing.assert_allclose(turned, mirror @ np.cross(rate, place), atol=1e-15)
    assert polar(1.0, tuple(velocity)) == tuple(velocity)
    assert axial(1.0, tuple(rate)) == tuple(rate)
