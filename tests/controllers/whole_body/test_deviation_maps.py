"""Each column of the maps is a motion that deviates from one task alone, by one unit."""

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.whole_body.kinematics import (
    NU,
    NV,
    PELVIS,
    TASKS,
    WAIST_DOF,
    LegInverses,
    Legs,
    com_compliance,
    sole_position,
    write_deviation_maps,
    write_leg_inverse,
)
from push_recovery.envs.robots.biped import PLAN, biped_model

MODEL = biped_model()


def sole_jacobian(data: mujoco.MjData, leg: int) -> np.ndarray:
    """Jacobian (6, 20) of a sole, linear part first."""
    J = np.zeros((6, NV))
    mujoco.mj_jacSite(MODEL, data, J[:3], J[3:], MODEL.site(PLAN.soles[leg]).id)
    return J


@pytest.mark.parametrize("stance", [0, 1])
def test_a_deviation_changes_its_own_task_by_one(random_state, robot_in, stance):
    """With M qdd = S' T_d + J_s' W_d: tasks(qdd) = identity, and the stance sole stays at rest."""
    rng = np.random.default_rng(stance)
    for _ in range(5):
        core, data = robot_in(*random_state(rng, 0.1), stance)
        inverses = LegInverses(np.empty((2, 6, 3)), np.empty((2, 6, 3)))
        left, right = sole_position(core.physics, 0, 0), sole_position(core.physics, 0, 1)
        for leg, sole in enumerate((left, right)):
            write_leg_inverse(core.physics, 0, leg, sole, 0.0, inverses)
        legs = Legs(stance, left, right, inverses, com_compliance(core.physics, 0, inverses))
        wrench, torque = np.empty((6, TASKS)), np.empty((NU, TASKS))
        write_deviation_maps(core.physics, 0, legs, wrench, torque)
        M, J = np.zeros((NV, NV)), sole_jacobian(data, stance)
        mujoco.mj_fullM(MODEL, data, M)
        qdd = np.linalg.solve(M, np.vstack([np.zeros((6, TASKS)), torque]) + J.T @ wrench)
        tasks = np.vstack([
            M[:3] @ qdd / M[0, 0],
            data.xmat[PELVIS].reshape(3, 3) @ qdd[3:6],
            sole_jacobian(data, 1 - stance) @ qdd,
            qdd[WAIST_DOF : WAIST_DOF + 2],
        ])  # fmt: skip
        np.testing.assert_allclose(tasks, np.eye(TASKS), atol=1e-8)
        np.testing.assert_allclose(J @ qdd, 0.0, atol=1e-8)
