import mujoco
import numpy as np
from push_recovery.controllers.whole_body.kinematics import (
    BASE,
    CHAIN,
    LEG_DOF,
    NV,
    ROW,
    LegInverses,
    com_compliance,
    com_velocity,
    sole_position,
    write_generalised_force,
    write_leg_inverse,
)
from push_recovery.envs.robots.biped import PLAN, biped_model

MODEL = biped_model()


def test_rows_and_columns_are_where_mujoco_stores_them():
    np.testing.assert_array_equal(ROW, MODEL.M_rowadr)
    for j in range(NV):
        columns = [*range(min(j, BASE)), *range(CHAIN[j] if j >= BASE else j, j + 1)]
        np.testing.assert_array_equal(MODEL.M_colind[ROW[j] :][: MODEL.M_rownnz[j]], columns)


def test_com_velocity_is_mujocos(random_state, robot_in):
    rng = np.random.default_rng(2)
    for _ in range(20):
        core, data = robot_in(*random_state(rng, 0.4))
        np.testing.assert_allclose(com_velocity(core.physics, 0), data.subtree_linvel[0], atol=1e-12)


def test_generalised_force_is_the_mass_matrix_times_acceleration_and_bias(random_state, robot_in):
    rng = np.random.default_rng(3)
    for _ in range(10):
        core, data = robot_in(*random_state(rng))
        qdd, expected, out = rng.normal(0.0, 10.0, NV), np.empty(NV), np.full(NV, np.nan)
        mujoco.mj_mulM(MODEL, data, expected, qdd)
        write_generalised_force(core.physics, 0, qdd, out)
        np.testing.assert_allclose(out, expected + data.qfrc_bias, atol=1e-9)


def test_compliance_gives_the_pelvis_the_acceleration_that_a_force_on_the_com_asks_for(
    random_state, robot_in
):
    """With qdd = (a, 0, 0, -J^-1 (a, 0) of both legs) the first three rows of M qdd are the force."""
    rng = np.random.default_rng(4)
    for _ in range(10):
        core, data = robot_in(*random_state(rng))
        inverses = LegInverses(np.empty((2, 6, 3)), np.empty((2, 6, 3)))
        for leg in range(2):
            write_leg_inverse(core.physics, 0, leg, sole_position(core.physics, 0, leg), 0.0, inverses)
        force, qdd, total = rng.normal(0.0, 100.0, 3), np.zeros(NV), np.empty(NV)
        qdd[:3] = np.array(com_compliance(core.physics, 0, inverses)) @ force
        for leg in range(2):
            sole = np.zeros((6, NV))
            mujoco.mj_jacSite(MODEL, data, sole[:3], sole[3:], MODEL.site(PLAN.soles[leg]).id)
            joints = slice(LEG_DOF[leg], LEG_DOF[leg] + 6)
            qdd[joints] = -np.linalg.solve(sole[:, joints], [*qdd[:3], 0.0, 0.0, 0.0])
        mujoco.mj_mulM(MODEL, data, total, qdd)
        np.testing.assert_allclose(total[:3], force, atol=1e-8)
