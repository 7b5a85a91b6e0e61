"""Joints with losses, bodies that collide, finer physics: each against MuJoCo by hand."""

import copy

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.model_errors import altered_model
from push_recovery.envs.robots.biped import PLAN, biped, biped_model
from push_recovery.envs.scenario.model_errors import EXACT_MODEL, ModelErrors, PhysicsOptions
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
ANKLE = "left_ankle_roll"
JOINTS = slice(6, 20)  # degrees of freedom of waist and legs


def own(**errors) -> mujoco.MjModel:
    model = altered_model(biped(), ModelErrors(**errors))
    assert model is not None
    return model


def weightless(model: mujoco.MjModel) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A copy without gravity, high over the floor, knees bent so that no joint is at its stop."""
    model = copy.copy(model)
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    data.qpos[2] = 3.0
    for side in ("left", "right"):
        data.joint(f"{side}_knee").qpos[0] = 0.6
    mujoco.mj_forward(model, data)
    return model, data


def rate_under(torque: float, **errors) -> float:
    """Rate of an ankle that has been driven from rest for 20 ms [rad/s]."""
    model, data = weightless(own(**errors) if errors else biped_model())
    data.actuator(ANKLE).ctrl[0] = torque
    for _ in range(10):
        mujoco.mj_step(model, data)
    return float(data.joint(ANKLE).qvel[0])


def test_a_joint_does_not_move_under_less_than_its_friction():
    free = rate_under(0.9)
    assert free > 1.0
    assert abs(rate_under(0.9, joint_friction=1.0)) < 0.05 * free  # MuJoCo's dry friction creeps a little
    assert abs(rate_under(-0.9, joint_friction=1.0)) < 0.05 * free
    assert rate_under(1.9, joint_friction=1.0) == pytest.approx(free, rel=0.03)  # what is left over drives it


def test_rotors_slow_the_joints_and_leave_the_base_alone():
    torque = np.zeros(20)
    torque[JOINTS] = np.linspace(-3.0, 4.0, 14)
    model, data = weightless(biped_model())
    matrix = np.zeros((20, 20))
    mujoco.mj_fullM(model, data, matrix)
    matrix += np.diag([0.0] * 6 + [0.03] * 14)
    heavy, data = weightless(own(armature=0.03))
    data.qfrc_applied[:] = torque
    mujoco.mj_forward(heavy, data)
    np.testing.assert_allclose(data.qacc, np.linalg.solve(matrix, torque), rtol=1e-6, atol=1e-8)


def test_damping_brakes_in_proportion():
    model, data = weightless(own(joint_damping=2.0))
    data.qvel[JOINTS] = np.linspace(-1.0, 1.0, 14)
    data.qvel[:6] = 0.3
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_passive[JOINTS], -2.0 * np.linspace(-1.0, 1.0, 14))
    np.testing.assert_array_equal(data.qfrc_passive[:6], 0.0)


def touching(model: mujoco.MjModel, data: mujoco.MjData) -> set[tuple[str, ...]]:
    """Pairs of bodies in contact."""
    mujoco.mj_forward(model, data)
    bodies = model.geom_bodyid
    return {tuple(sorted(model.body(bodies[g]).name for g in contact.geom)) for contact in data.contact}


def test_a_trunk_falls_through_the_floor_unless_it_collides():
    for collisions, met in ((False, False), (True, True)):
        model = own(collisions=True) if collisions else biped_model()
        data = mujoco.MjData(model)
        data.qpos[2], data.qpos[3:7] = 0.1, [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]  # on its belly
        assert (("trunk", "world") in touching(model, data)) == met


def test_a_hand_meets_a_thigh_that_is_lifted_outwards():
    model, data = weightless(own(collisions=True))
    data.joint("left_hip_pitch").qpos[0] = -1.6
    data.joint("left_hip_yaw").qpos[0] = 0.6
    assert ("left_thigh", "trunk") in touching(model, data)
    plain, data = weightless(biped_model())
    data.joint("left_hip_pitch").qpos[0] = -1.6
    data.joint("left_hip_yaw").qpos[0] = 0.6
    assert not touching(plain, data)


def test_soles_touch_the_floor_as_without_collisions():
    """No contact of a sole is counted twice, and nothing else touches in a normal stance."""
    found = []
    for model in (biped_model(), own(collisions=True)):
        data = mujoco.MjData(model)
        for side in ("left", "right"):
            for joint, angle in zip(("hip_pitch", "knee", "ankle_pitch"), (-0.3, 0.6, -0.3), strict=True):
                data.joint(f"{side}_{joint}").qpos[0] = angle
        mujoco.mj_forward(model, data)
        data.qpos[2] -= data.site("left_sole").xpos[2] + 0.001
        mujoco.mj_forward(model, data)
        found.append((data.ncon, np.array(data.qfrc_constraint)))
    assert found[0][0] == found[1][0] == 8
    np.testing.assert_allclose(found[1][1], found[0][1], rtol=1e-9, atol=1e-9)


def test_friction_is_that_of_all_that_collides():
    model = own(collisions=True, friction=0.5)
    solid = model.geom_contype > 0
    np.testing.assert_array_equal(model.geom_friction[solid, 0], 0.5)
    assert {model.geom(name).id for name in PLAN.sole_boxes} <= set(np.flatnonzero(solid))


def test_options_are_those_of_the_model():
    options = PhysicsOptions(0.0005, "rk4", "cg", "elliptic", 10.0, 0.02)
    model = altered_model(biped(), EXACT_MODEL, options)
    assert model is not None
    assert (model.opt.timestep, model.opt.impratio) == (0.0005, 10.0)
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert model.opt.solver == mujoco.mjtSolver.mjSOL_CG
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    np.testing.assert_array_equal(model.pair_solref, [[0.02, 1.0]] * model.npair)
    assert biped_model().opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST


@pytest.mark.parametrize("options", [PhysicsOptions(0.001, cone="elliptic"), PhysicsOptions(0.0005, "rk4")])
def test_steps_of_control_are_plain_steps_of_mujoco(biped_core, begin, options):
    """Torques and push held for 2 ms: the state of mj_step to the last bit, and the mean of its forces."""
    core = biped_core()
    begin(core, 0, Scenario("a", (Push((60.0, 90.0, 0.0), 0.1, 0.05),), physics=options))
    model, data, seen = core.simulations.models[0], mujoco.MjData(core.simulations.models[0]), []
    assert model.opt.timestep == options.time_step
    data.qpos[:], data.qvel[:] = core.simulations.data[0].qpos, core.simulations.data[0].qvel
    mujoco.mj_step1(model, data)

    def look():
        data.ctrl[:], data.xfrc_applied[:] = (
            core.simulations.data[0].ctrl,
            core.simulations.data[0].xfrc_applied,
        )
        force = np.zeros(20)
        for _ in range(options.steps):
            if options.integrator == "rk4":
                mujoco.mj_step(model, data)
            else:
                mujoco.mj_step2(model, data)
            mujoco.mj_step1(model, data)
            force += data.qfrc_constraint
        np.testing.assert_array_equal(data.qpos, core.physics.qpos[0])
        np.testing.assert_array_equal(data.qvel, core.physics.qvel[0])
        np.testing.assert_allclose(core.contacts.force[0], force / options.steps, rtol=1e-12, atol=1e-9)
        seen.append(core.gait.time[0])

    core.after_physics_step = look
    for _ in range(20):
        action = POLICY.predict(core.observation)[0]
        core.step(BIPED_LIMITS.from_action(action), action.astype(np.float64))
    assert len(seen) == 100
    assert not core.gait.failure[0]


def test_a_robot_with_losses_beside_others_is_the_one_alone(biped_core, begin):
    """Models of other sizes in one core, and nothing left of them after the next reset."""
    losses = ModelErrors(joint_friction=1.0, armature=0.03, collisions=True, bus_power=800.0, delay=0.004)
    fine = PhysicsOptions(0.001, cone="elliptic", impratio=10.0)
    push = (Push((200.0, 300.0, 0.0), 0.1, 0.05),)
    episodes = [
        Scenario("a", push, errors=losses, physics=fine),
        Scenario("b", push),
        Scenario("c", physics=fine),
    ]

    def run(core, scenarios) -> np.ndarray:
        for k, scenario in enumerate(scenarios):
            begin(core, k, scenario)
        for _ in range(60):
            actions = POLICY.predict(core.observation)[0]
            core.step(BIPED_LIMITS.from_action(actions), actions.astype(np.float64))
        return core.physics.qpos.copy()

    core = biped_core(3)
    together = run(core, episodes)
    assert not np.array_equal(together[0], together[1])
    np.testing.assert_array_equal(run(core, episodes[::-1]), together[::-1])
    for k, scenario in enumerate(episodes):
        np.testing.assert_array_equal(run(biped_core(1), [scenario])[0], together[k])
