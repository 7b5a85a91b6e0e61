"""Simulations advanced from compiled code against MuJoCo's own step."""

import mujoco
import numpy as np
from push_recovery.envs.robots.biped import biped_model
from push_recovery.envs.simulation import Simulations, advance

MODEL = biped_model()
OUTPUTS = ("qpos", "qvel", "xmat", "qfrc_bias", "qfrc_constraint", "sensordata", "M")


def test_it_is_mujocos_own_step_bit_for_bit(random_state):
    rng = np.random.default_rng(0)
    several = Simulations(MODEL, 3, ("ctrl", "xfrc_applied"), OUTPUTS)
    alone, contacts = [mujoco.MjData(MODEL) for _ in range(3)], 0
    for k, data in enumerate(alone):
        qpos, qvel = random_state(rng)
        several.put(k, qpos, qvel)
        data.qpos[:], data.qvel[:] = qpos, qvel
    for _ in range(40):
        for k, data in enumerate(alone):
            ctrl, force = rng.normal(0.0, 20.0, MODEL.nu), rng.normal(0.0, 5.0, (MODEL.nbody, 6))
            several.arrays["ctrl"][k], several.arrays["xfrc_applied"][k] = ctrl, force
            advance(several.handles, k)
            data.ctrl[:], data.xfrc_applied[:] = ctrl, force
            mujoco.mj_step(MODEL, data)
            contacts += data.ncon
    assert contacts > 0
    for k, data in enumerate(alone):
        for name in ("qpos", "qvel"):
            np.testing.assert_array_equal(several.arrays[name][k], getattr(data, name))
        for name in ("qfrc_constraint", "sensordata"):  # of the step made
            np.testing.assert_array_equal(several.arrays[name][k], getattr(data, name))
        mujoco.mj_step1(MODEL, data)
        for name in ("xmat", "qfrc_bias", "M"):  # of the state reached
            np.testing.assert_array_equal(several.arrays[name][k], getattr(data, name))


def test_a_state_that_was_put_is_current_and_free_of_what_was(random_state):
    rng = np.random.default_rng(1)
    used, fresh = (Simulations(MODEL, 2, ("ctrl",), OUTPUTS) for _ in range(2))
    used.put(0, *random_state(rng))
    used.arrays["ctrl"][0] = 30.0
    for _ in range(20):
        advance(used.handles, 0)
    state = random_state(rng)
    for simulations in (used, fresh):
        simulations.put(0, *state)
        assert not simulations.arrays["ctrl"][0].any()
        np.testing.assert_array_equal(simulations.arrays["qpos"][0], state[0])
        for _ in range(3):
            advance(simulations.handles, 0)
    for name, array in fresh.arrays.items():
        np.testing.assert_array_equal(used.arrays[name], array)


def test_the_given_model_stays_as_it_is():
    flags = MODEL.opt.disableflags
    Simulations(MODEL, 1, (), ("qpos",))
    assert MODEL.opt.disableflags == flags
