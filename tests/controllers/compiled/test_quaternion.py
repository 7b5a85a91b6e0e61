"""Quaternions against MuJoCo's."""

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.math3 import conjugate, normalised, of_rotation, product, rotated, rotation_of

RNG = np.random.default_rng(1)
A, B = (tuple(q / np.linalg.norm(q)) for q in RNG.normal(size=(2, 4)))
VECTOR = (0.3, -1.2, 0.7)


def test_a_product_is_the_second_rotation_and_then_the_first():
    want = np.zeros(4)
    mujoco.mju_mulQuat(want, np.array(A), np.array(B))
    np.testing.assert_allclose(product(A, B), want, atol=1e-15)
    np.testing.assert_allclose(rotated(product(A, B), VECTOR), rotated(A, rotated(B, VECTOR)), atol=1e-15)


def test_a_vector_is_turned_as_by_mujoco_and_back():
    want = np.zeros(3)
    mujoco.mju_rotVecQuat(want, np.array(VECTOR), np.array(A))
    np.testing.assert_allclose(rotated(A, VECTOR), want, atol=1e-15)
    np.testing.assert_allclose(rotated(conjugate(A), rotated(A, VECTOR)), VECTOR, atol=1e-15)


def test_a_quarter_turn_about_z_brings_x_to_y():
    q = of_rotation((0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(q, [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], atol=1e-15)
    np.testing.assert_allclose(rotated(q, (1.0, 0.0, 0.0)), [0.0, 1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-3, 2.0])
def test_rotations_of_any_size_are_unit_quaternions(angle):
    axis = np.array([0.6, 0.0, -0.8])
    q, want = of_rotation(tuple(angle * axis)), np.zeros(4)
    mujoco.mju_axisAngle2Quat(want, axis, angle)
    np.testing.assert_allclose(q, want, rtol=1e-14, atol=1e-17)
    np.testing.assert_allclose(rotation_of(q), angle * axis, rtol=1e-14, atol=1e-17)


def test_normalised_keeps_the_direction():
    np.testing.assert_allclose(normalised(tuple(3.0 * np.array(A))), A, atol=1e-15)
