"""CoP and CMP against the contacts that MuJoCo finds."""

import mujoco
import numpy as np
import pytest
from push_recovery.envs.joint.core import write_floor_points
from push_recovery.envs.robots.biped import biped_model

FLOOR = biped_model().geom("floor").id


def floor_forces(data):
    """Points (m, 3) [m] and forces (m, 3) [N] of the contacts between floor and robot."""
    points, forces, force = [], [], np.empty(6)
    for i, contact in enumerate(data.contact):
        if FLOOR in contact.geom:
            mujoco.mj_contactForce(biped_model(), data, i, force)
            up = 1.0 if contact.geom[0] == FLOOR else -1.0
            points.append(contact.pos.copy())
            forces.append(up * contact.frame.reshape(3, 3).T @ force[:3])
    return np.array(points), np.array(forces)


@pytest.mark.parametrize("seed", range(4))
def test_the_moment_about_the_cop_is_vertical_and_the_force_points_from_the_cmp_to_the_com(
    robot_in, random_state, seed
):
    rng = np.random.default_rng(seed)
    qpos, qvel = random_state(rng, 0.005)
    qpos[2] -= 0.004  # both feet stand
    core, data = robot_in(qpos, qvel)
    core.judged.com[0, 0] = data.subtree_com[0]
    points, forces = floor_forces(data)
    assert len(points) >= 3
    world, total = np.full(6, np.nan), forces.sum(axis=0)
    write_floor_points(core.judged, core.gait, 0, data.qfrc_constraint.copy(), world)
    arms = points - [*world[2:4], 0.0]  # of points a little under the floor
    moment = np.cross(arms, forces).sum(axis=0)
    np.testing.assert_allclose(moment[:2], 0.0, atol=1e-6 * np.abs(forces).sum())
    line = data.subtree_com[0] - [*world[4:6], 0.0]
    np.testing.assert_allclose(np.cross(line, total), 0.0, atol=1e-6 * np.linalg.norm(total))


def test_in_flight_both_stay(robot_in, random_state):
    core, _ = robot_in(*random_state(np.random.default_rng(0)))
    world = np.arange(6.0)
    write_floor_points(core.judged, core.gait, 0, np.zeros(20), world)
    np.testing.assert_array_equal(world, np.arange(6.0))
