"""Joints with losses, bodies that collide, finer physics: each against MuJoCo by hand.

Bipeds that are not what their planner believes: physics, what control sees, repeatability.
"""

import copy

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.estimation.self_model import FRICTION, ROTOR
from push_recovery.controllers.model.observation import COM, COM_VELOCITY, DCM, PUSH_ESTIMATE
from push_recovery.controllers.model.robot import GRAVITY
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import FOOT_BODY, PELVIS, TRUNK
from push_recovery.envs.biped import model_errors
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.model_errors import LONGEST_DELAY, RATE_NOISE, altered_model
from push_recovery.envs.robots.biped import ARMS_HELD, PLAN, biped, biped_model
from push_recovery.envs.robots.compiled_robot import compiled_robot
from push_recovery.envs.scenario.model_errors import EXACT_MODEL, ModelErrors, PhysicsOptions
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.envs.scenario.terrain import Stairs

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
ANKLE = "left_ankle_roll"
JOINTS = slice(6, 20)  # degrees of freedom of waist and legs


def model_of(**errors) -> mujoco.MjModel:
    own = altered_model(biped(), ModelErrors(**errors))
    assert own is not None
    return own


def step(core) -> None:
    action = POLICY.predict(core.observation)[0]
    core.step(BIPED_LIMITS.from_action(action), action.astype(np.float64))


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
    model, data = weightless(model_of(**errors) if errors else biped_model())
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
    heavy, data = weightless(model_of(armature=0.03))
    data.qfrc_applied[:] = torque
    mujoco.mj_forward(heavy, data)
    np.testing.assert_allclose(data.qacc, np.linalg.solve(matrix, torque), rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize(
    ("errors", "mismatched", "physical"),
    [
        ({}, 0, 0), ({"friction": 0.5}, 0, 0), ({"floor_step": 0.01}, 0, 0), ({"dcm_noise": 0.01}, 0, 0),
        ({"joint_friction": 0.5}, 0, 0), ({"delay": 0.004}, 0, 1), ({"motor_power": 300.0}, 0, 1),
        ({"mass": 0.1}, 1, 1), ({"armature": 0.01}, 1, 1), ({"joint_noise": 0.001}, 1, 1),
        ({"slope_forward": 0.05}, 1, 1), ({"slope_left": -0.05}, 1, 1),
    ],
)  # fmt: skip
def test_what_control_takes_for_the_robot_is_another_one_where_kinematics_or_dynamics_are(
    errors, mismatched, physical
):
    table = model_errors.no_errors(1)
    model_errors.assign_errors(table, 0, Scenario("a", errors=ModelErrors(**errors)), biped())
    assert (table.mismatched[0], table.physical[0]) == (mismatched, physical)


@pytest.mark.parametrize("errors", [{}, {"mass": 0.2}, {"armature": 0.05}, {"mass": 0.2, "armature": 0.05}])
def test_drives_know_the_inertia_of_their_joints_with_all_that_is_added(errors):
    """The diagonal of MuJoCo's mass matrix of the altered robot."""
    table = model_errors.no_errors(2)
    model_errors.assign_errors(table, 1, Scenario("a", errors=ModelErrors(**errors)), biped())
    model = model_of(**errors) if errors else biped_model()
    data, products = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    for unit, product in zip(np.eye(model.nv), products, strict=True):
        mujoco.mj_mulM(model, data, product, unit)
    np.testing.assert_allclose(table.motors[1, model_errors.INERTIA], np.diag(products)[JOINTS], rtol=1e-9)
    assert not table.motors[0].any()


def test_damping_brakes_in_proportion():
    model, data = weightless(model_of(joint_damping=2.0))
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
        model = model_of(collisions=True) if collisions else biped_model()
        data = mujoco.MjData(model)
        data.qpos[2], data.qpos[3:7] = 0.1, [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]  # on its belly
        assert (("trunk", "world") in touching(model, data)) == met


def test_a_hand_meets_a_thigh_that_is_lifted_outwards():
    model, data = weightless(model_of(collisions=True))
    data.joint("left_hip_pitch").qpos[0] = -1.6
    data.joint("left_hip_yaw").qpos[0] = 0.6
    assert ("left_thigh", "trunk") in touching(model, data)
    plain, data = weightless(biped_model())
    data.joint("left_hip_pitch").qpos[0] = -1.6
    data.joint("left_hip_yaw").qpos[0] = 0.6
    assert not touching(plain, data)


def test_bodies_that_touch_while_the_robot_stands_do_not_collide(monkeypatch):
    """Told so of trunk and thigh, they pass through each other, and the other thigh does not."""
    monkeypatch.setattr(model_errors, "touching", lambda robot, model: [("trunk", "left_thigh")])
    spec = biped().description.spec()
    model_errors.add_collisions(spec, biped())
    compiled = biped().compiled(spec)
    for side, meets in (("left", False), ("right", True)):
        model, data = weightless(compiled)
        data.joint(f"{side}_hip_pitch").qpos[0] = -1.6
        data.joint(f"{side}_hip_yaw").qpos[0] = 0.6 if side == "left" else -0.6
        assert ((f"{side}_thigh", "trunk") in touching(model, data)) == meets


def test_soles_touch_the_floor_as_without_collisions():
    """No contact of a sole is counted twice, and nothing else touches in a normal stance."""
    found = []
    for model in (biped_model(), model_of(collisions=True)):
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


def test_gravity_on_a_slope_is_turned_and_no_larger():
    """A floor that rises by 0.08 rad ahead pulls back by sin, down by cos; two slopes by their tangents."""
    ahead, aside = model_of(slope_forward=0.08).opt.gravity, model_of(slope_left=-0.08).opt.gravity
    np.testing.assert_allclose(ahead, [-0.783963148, 0.0, -9.778624739], rtol=1e-8)
    np.testing.assert_allclose(aside, [0.0, 0.783963148, -9.778624739], rtol=1e-8)
    both = model_of(slope_forward=0.08, slope_left=0.05).opt.gravity
    assert np.linalg.norm(both) == pytest.approx(9.81)
    np.testing.assert_allclose(both[:2] / both[2], [0.0801711, 0.0500417], rtol=1e-5)


def test_floors_of_all_steps_share_a_model_whose_tiles_each_robot_copies():
    low, high = (altered_model(biped(), ModelErrors(floor_step=step)) for step in (0.002, 0.02))
    assert low is high
    slippery = model_of(floor_step=0.01, friction=0.3)
    pairs = slippery.geom_bodyid[slippery.pair_geom1] == 0
    assert pairs.sum() >= 8  # four tiles a foot
    assert (slippery.pair_friction[pairs, :2] == 0.3).all()
    assert (slippery.pair_friction[~pairs] == biped_model().pair_friction[-(~pairs).sum() :]).all()


def test_of_a_foot_only_the_sole_collides_and_all_that_does_is_as_hard_as_the_soles():
    model = model_of(collisions=True)
    collides = (model.geom_contype == 1) & (model.geom_conaffinity == 1)
    assert ((model.geom_contype == 1) == (model.geom_conaffinity == 1)).all()
    for g in range(model.ngeom):
        if model.body(model.geom_bodyid[g]).name in {"left_foot", "right_foot"}:
            assert collides[g] == (model.geom(g).name in PLAN.sole_boxes)
    assert collides.sum() > 10
    np.testing.assert_array_equal(
        model.geom_solref[collides], np.tile(model.pair_solref[0], (collides.sum(), 1))
    )


def test_friction_is_that_of_all_that_collides():
    model = model_of(collisions=True, friction=0.5)
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


@pytest.mark.parametrize(
    "options",
    [
        PhysicsOptions(0.001, cone="elliptic"),
        PhysicsOptions(0.0005, "rk4"),
        PhysicsOptions(integrator="rk4"),
    ],
)
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
        step(core)
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
            step(core)
        return core.physics.qpos.copy()

    core = biped_core(3)
    together = run(core, episodes)
    assert not np.array_equal(together[0], together[1])
    np.testing.assert_array_equal(run(core, episodes[::-1]), together[::-1])
    for k, scenario in enumerate(episodes):
        np.testing.assert_array_equal(run(biped_core(1), [scenario])[0], together[k])


MODEL = biped_model()
BODIES = [PELVIS, TRUNK, *FOOT_BODY]
READ = {"xpos": BODIES, "xmat": BODIES, "subtree_com": [0]}  # rows that control reads; all of other fields
PUSH = Push((60.0, 90.0, 0.0), 0.1, GaitEvent(1, "right", 0.3))
BODY = ModelErrors(mass=0.1, payload=3.0, trunk_com=(0.01, -0.01, 0.02), slope_forward=0.03, slope_left=-0.02)
DIFFERENT = (
    ModelErrors(mass=0.1),
    ModelErrors(delay=0.01, dcm_noise=0.004),
    ModelErrors(),
    ModelErrors(friction=0.5, payload=4.0),
    ModelErrors(slope_left=0.04, delay=0.004),
    ModelErrors(joint_noise=5e-4),
    BODY,
    ModelErrors(trunk_com=(0.0, 0.02, 0.0), dcm_noise=0.002),
    ModelErrors(floor_step=0.015, delay=0.002),
    ModelErrors(continuous_torque=0.4, delay=0.004),
)


def scenarios(all_errors=DIFFERENT) -> list[Scenario]:
    return [
        Scenario(
            f"s{k}", (PUSH,), Command(0.1 * (k % 3)), ("left", "right")[k % 2], noise_seed=k, errors=errors
        )
        for k, errors in enumerate(all_errors)
    ]


def trajectory(core, begin, all_scenarios, seconds: float) -> np.ndarray:
    """True state of the physics and what is seen at every planning period, (ticks, n, 77)."""
    for k, scenario in enumerate(all_scenarios):
        begin(core, k, scenario)
    out = []
    for _ in range(round(seconds * 100)):
        step(core)
        state = [np.concatenate([data.qpos, data.qvel]) for data in core.simulations.data]
        out.append(np.concatenate([np.array(state), core.observation], axis=1))
    return np.array(out)


# The robot's own model


def test_masses_and_inertias_scale_alike():
    data, own = mujoco.MjData(MODEL), model_of(mass=0.1)
    heavier = mujoco.MjData(own)
    M, M_own = np.zeros((2, MODEL.nv, MODEL.nv))
    for model, state, out in ((MODEL, data, M), (own, heavier, M_own)):
        state.qpos[7:] += 0.1
        mujoco.mj_forward(model, state)
        mujoco.mj_fullM(model, state, out)
    np.testing.assert_allclose(M_own, 1.1 * M, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(own.body_subtreemass[0], 1.1 * BIPED.mass)
    np.testing.assert_allclose(own.body_invweight0, MODEL.body_invweight0 / 1.1, rtol=1e-9)
    np.testing.assert_allclose(heavier.subtree_com, data.subtree_com, atol=1e-14)


def test_payload_and_trunk_com_move_the_com_of_the_whole():
    own = model_of(payload=6.0, trunk_com=(0.01, 0.02, -0.03))
    data, off = mujoco.MjData(MODEL), mujoco.MjData(own)
    mujoco.mj_forward(MODEL, data), mujoco.mj_forward(own, off)
    assert own.body_subtreemass[0] == pytest.approx(66.0)
    trunk = data.xipos[TRUNK] + [0.01, 0.02, -0.03]
    moment = 60.0 * data.subtree_com[0] - 30.0 * data.xipos[TRUNK] + 36.0 * trunk
    np.testing.assert_allclose(off.subtree_com[0], moment / 66.0, atol=1e-14)


@pytest.mark.parametrize("friction", [0.25, 0.5])
def test_a_sole_slips_at_mu_times_the_normal_force(biped_core, begin, friction):
    """A pyramid bounds the tangential force: |f_x| + |f_y| <= mu f_z, and a sliding sole is on it."""
    core, shares = biped_core(), []

    def look():
        force = core.contacts.force[0]
        if force[2] > 100.0:
            shares.append((abs(force[0]) + abs(force[1])) / force[2])

    core.after_physics_step = look
    push = Push((700.0, 0.0, 0.0), 0.2, 0.1)
    begin(core, 0, Scenario("a", (push,), errors=ModelErrors(friction=friction)))
    for _ in range(40):
        step(core)
    assert max(shares) == pytest.approx(friction, rel=1e-3)
    assert MODEL.pair_friction[0, 0] == 0.9


def test_a_slope_pulls_downhill_like_a_push(biped_core, begin):
    """Mean push estimate = -h tan(slope): the external force over m omega^2, omega^2 = g / h."""
    own = model_of(slope_forward=0.03, slope_left=-0.04)
    np.testing.assert_allclose(np.linalg.norm(own.opt.gravity), GRAVITY)
    np.testing.assert_allclose(own.opt.gravity[:2] / own.opt.gravity[2], np.tan([0.03, -0.04]))
    core, estimates = biped_core(), []
    begin(core, 0, Scenario("a", errors=ModelErrors(slope_forward=0.03, slope_left=-0.04)))
    for _ in range(120):
        step(core)
        estimates.append(core.truth[0, PUSH_ESTIMATE] * [1.0, -1.0 if core.gait.stance[0] == 0 else 1.0])
    downhill = -BIPED.com_height * np.tan([0.03, -0.04])
    np.testing.assert_allclose(np.mean(estimates, axis=0), downhill, atol=2e-3)


def test_equal_errors_share_a_model_and_none_have_the_common_one(biped_core, begin):
    core = biped_core(3)
    for k, errors in enumerate((BODY, BODY, ModelErrors(delay=0.01, dcm_noise=0.01, joint_noise=0.001))):
        begin(core, k, Scenario("a", errors=errors))
    models = core.simulations.models
    assert models[0] is models[1] is not models[2]
    assert models[2] is core.simulations.model
    begin(core, 0, Scenario("a"))
    assert core.simulations.models[0] is core.simulations.model
    assert not core.errors.physical[0]


# What control sees


@pytest.mark.parametrize(
    "errors", [BODY, ModelErrors(joint_noise=1e-3), ModelErrors(mass=-0.2, delay=0.004)], ids=str
)
def test_control_believes_the_nominal_robot_in_the_measured_state(biped_core, begin, errors):
    core, data = biped_core(), mujoco.MjData(MODEL)
    begin(core, 0, Scenario("a", (PUSH,), noise_seed=4, errors=errors))
    fields = ("xpos", "xmat", "xanchor", "xaxis", "subtree_com")
    for tick in range(60):
        arrays, true = core.simulations.arrays, core.simulations.data[0]
        data.qpos[:], data.qvel[:] = arrays["qpos"][0], arrays["qvel"][0]
        mujoco.mj_step1(MODEL, data)
        for name in fields:
            rows = READ.get(name, slice(None))
            assert arrays[name][0][rows].tobytes() == getattr(data, name)[rows].tobytes(), (tick, name)
        for name in ("sensordata", "qfrc_constraint"):
            assert arrays[name][0].tobytes() == getattr(true, name).tobytes()
        factor = arrays["M"][0, 0] / data.M[0]  # the mass that it has found, see test_self_model.py
        assert abs(factor - 1.0) < 0.2
        lost, added = core.known.joints[0], np.zeros(MODEL.nM)  # and of its joints, see test_joint_losses.py
        added[(MODEL.M_rowadr + MODEL.M_rownnz - 1)[6:]] = lost[:, ROTOR]
        rubs = np.r_[np.zeros(6), lost[:, FRICTION] * np.clip(data.qvel[6:] / 0.1, -1.0, 1.0)]
        np.testing.assert_allclose(arrays["M"][0], factor * data.M + added, rtol=1e-14)
        np.testing.assert_allclose(arrays["qfrc_bias"][0], factor * data.qfrc_bias + rubs, rtol=1e-13)
        assert not np.array_equal(arrays["qfrc_bias"][0], true.qfrc_bias) or tick == 0
        step(core)


def test_joint_noise_has_the_stated_size_and_leaves_the_pelvis_alone(biped_core, begin):
    core, angles, rates = biped_core(), [], []

    def look():
        arrays, true = core.simulations.arrays, core.simulations.data[0]
        assert arrays["qpos"][0, :7].tobytes() == true.qpos[:7].tobytes()
        assert arrays["qvel"][0, :6].tobytes() == true.qvel[:6].tobytes()
        angles.append(arrays["qpos"][0, 7:] - true.qpos[7:])
        rates.append(arrays["qvel"][0, 6:] - true.qvel[6:])

    core.after_physics_step = look
    begin(core, 0, Scenario("a", noise_seed=2, errors=ModelErrors(joint_noise=1e-3)))
    for _ in range(150):
        step(core)
    assert core.gait.failure[0] == 0
    for noise, size in ((np.array(angles), 1e-3), (np.array(rates), RATE_NOISE * 1e-3)):
        np.testing.assert_allclose(noise.std(axis=0), size, rtol=0.12)
        assert np.abs(np.corrcoef(noise.T) - np.eye(14)).max() < 0.17
        assert abs(np.mean(noise[1:] * noise[:-1])) < 0.05 * size**2


@pytest.mark.parametrize("steps", [1, 5, LONGEST_DELAY])
def test_torques_act_late_by_whole_physics_steps(biped_core, begin, steps):
    core, asked, acted = biped_core(), [], []

    def look():
        ring = core.errors.torques[0]
        asked.append(ring[(core.errors.step[0] - 1) % len(ring)].copy())
        acted.append(core.simulations.data[0].ctrl.copy())

    core.after_physics_step = look
    begin(core, 0, Scenario("a", errors=ModelErrors(delay=0.002 * steps)))
    for _ in range(12):  # at 50 ms it is so fast after 16 that its drives limit the torques
        step(core)
    late = [asked[0]] * steps + asked[:-steps]
    np.testing.assert_array_equal(acted, late)
    prompt = biped_core()
    begin(prompt, 0, Scenario("a"))
    first = []
    prompt.after_physics_step = lambda: first.append(prompt.simulations.data[0].ctrl.copy())
    step(prompt)
    np.testing.assert_array_equal(first[0], asked[0])
    assert not np.array_equal(asked[-1], acted[-1])


def test_late_torques_keep_to_the_line_of_the_speed_at_which_they_act(biped_core, begin):
    """A torque that was allowed 20 ms ago may be more than the motor gives at the speed of now."""
    core, found, before = biped_core(), [], np.zeros(14)

    def look():
        late = core.errors.torques[0, (core.errors.step[0] - 1 - 10) % core.errors.torques.shape[1]]
        found.append((late.copy(), core.simulations.data[0].ctrl.copy(), before.copy()))
        before[:] = core.simulations.data[0].qvel[6:]

    core.after_physics_step = look
    begin(core, 0, Scenario("a", (Push((900.0, 0.0, 0.0), 0.1, 0.1),), errors=ModelErrors(delay=0.02)))
    for _ in range(60):
        step(core)
    late, acted, speed = (np.array(column) for column in zip(*found[11:], strict=True))
    top, free = MODEL.actuator_forcerange[:, 1], MODEL.actuator_user[:, 0]
    line = top * np.clip((1.0 - np.abs(speed) / free) / 0.3, 0.0, 1.0)
    slope = top / (0.3 * free)
    brake = slope * (np.abs(speed) - free) / (1.0 + slope * 0.002 / MODEL.dof_M0[6:])
    line = np.where(brake > 0.0, -np.minimum(brake, top), line)
    driving = np.where(speed >= 0.0, 1.0, -1.0) * np.array([late, acted])
    assert (driving[1] <= line + 1e-9).all()
    assert (driving[0] > line + 1.0).any()
    np.testing.assert_allclose(driving[1], np.clip(driving[0], -top, line), atol=1e-9)


@pytest.mark.parametrize("errors", [ModelErrors(), ModelErrors(delay=0.002)])
def test_a_joint_beyond_its_speed_without_load_is_braked(biped_core, begin, errors):
    """The right ankle's pitch at 20 rad/s, 9 without load: the line is 150 / 2.7 N m s/rad, capped at 150."""
    core = biped_core()
    begin(core, 0, Scenario("a", errors=errors))
    qpos, qvel = (field.copy() for field in (core.physics.qpos[0], core.physics.qvel[0]))
    qpos[2] += 1.0  # in the air
    qvel[18], qvel[19] = 20.0, -10.0
    core.put(0, qpos, qvel)
    torques = []
    core.after_physics_step = lambda: torques.append(core.simulations.data[0].ctrl.copy())
    step(core)
    pitch, roll = torques[0][12:]
    slopes = np.array([150.0, 100.0]) / (0.3 * 9.0)
    least = slopes * [11.0, 1.0] / (1.0 + slopes * 0.002 / MODEL.dof_M0[18:])
    assert pitch <= -least[0] + 1e-9
    assert roll >= least[1] - 1e-9


def test_a_delay_that_is_no_whole_number_of_steps_changes_nothing(biped_core, begin):
    core = biped_core()
    begin(core, 0, scenarios()[0])
    before = core.physics.qpos.copy(), core.errors.physical.copy()
    text = r"delay \[s\] must be a multiple of 0.002 .* up to 0.05, got 0.003"
    with pytest.raises(InvalidValueError, match=text):
        begin(core, 0, Scenario("a", errors=ModelErrors(delay=0.003)))
    np.testing.assert_array_equal(before[0], core.physics.qpos)
    np.testing.assert_array_equal(before[1], core.errors.physical)


# What the policy sees


def test_dcm_noise_is_white_of_the_stated_size_and_consistent(biped_core, begin):
    core, seen, true, steps = biped_core(), [], [], []
    begin(core, 0, Scenario("a", noise_seed=3, errors=ModelErrors(dcm_noise=0.002)))
    for _ in range(400):
        seen.append(core.observation[0].copy())
        true.append(core.truth[0].copy())
        steps.append(core.gait.steps[0])
        core.known.felt[0, 2] = 0.0  # otherwise it soon knows this noise, and the push is not shown
        step(core)
    assert core.gait.failure[0] == 0
    side = np.stack([np.ones(400), np.where(np.array(steps) % 2 == 0, 1.0, -1.0)], axis=1)
    noise = np.array(seen) - np.array(true)
    dcm, velocity = side * noise[:, DCM], side * noise[:, COM_VELOCITY]
    np.testing.assert_allclose(dcm.std(axis=0), 0.002, rtol=0.12)
    np.testing.assert_allclose(velocity.std(axis=0), BIPED.omega * 0.002 / np.sqrt(2.0), rtol=0.12)
    assert np.abs([np.corrcoef(axis[1:], axis[:-1])[0, 1] for axis in dcm.T]).max() < 0.15
    np.testing.assert_allclose(
        noise[:, DCM], noise[:, COM] + noise[:, COM_VELOCITY] / BIPED.omega, atol=1e-15
    )
    jump = (velocity[1:] - velocity[:-1]) / (BIPED.omega**2 * 0.01)  # what a change of velocity tells
    np.testing.assert_allclose(noise[0, PUSH_ESTIMATE], 0.0)
    np.testing.assert_allclose(side[1:] * noise[1:, PUSH_ESTIMATE], jump, atol=1e-12)
    others = np.delete(noise, [*range(1, 7), 34, 35], axis=1)
    assert not others.any()


def test_a_fallen_robot_is_seen_as_it_was(biped_core, begin):
    core = biped_core()
    fall = Push((0.0, 3000.0, 0.0), 0.1, 0.2)
    begin(core, 0, Scenario("a", (fall,), errors=ModelErrors(dcm_noise=0.01, payload=2.0)))
    for _ in range(300):
        step(core)
    assert core.gait.failure[0] != 0
    before = core.observation[0].copy()
    step(core)
    kept = np.delete(before, range(27, 34))  # all but the previous action
    np.testing.assert_array_equal(np.delete(core.observation[0], range(27, 34)), kept)


def test_a_resting_robot_is_not_moved_by_its_drift_again(biped_core, begin):
    """In noise what it sees stays as it was: a drift that it has learned is in there already."""
    core, push = biped_core(2), Push((0.0, 900.0, 0.0), 0.2, 0.05)
    for k, noise in enumerate((0.003, 0.0)):
        begin(core, k, Scenario(f"{k}", (push,), errors=ModelErrors(dcm_noise=noise)))
    for _ in range(200):
        step(core)
    assert core.gait.failure.all()
    action, held = np.zeros((2, 7)), BIPED_LIMITS.from_action(np.zeros((2, 7)))
    core.known.drift[:], core.known.felt[:] = (0.03, -0.02), 0.0
    core.step(held, action)
    seen = core.observation.copy()
    for _ in range(3):
        core.step(held, action)
        np.testing.assert_array_equal(core.observation, seen)
    shift = core.observation[1, DCM] - core.truth[1, DCM]
    np.testing.assert_allclose(np.abs(shift), [0.03, 0.02], atol=1e-12)


def test_without_noise_all_that_is_true_is_seen(biped_core, begin):
    core = biped_core(2)
    begin(core, 0, Scenario("a", errors=ModelErrors(mass=0.1)))
    begin(core, 1, Scenario("b"))
    for _ in range(5):
        step(core)
        assert core.observation.tobytes() == core.truth.tobytes()


# Repeatability


def test_robots_together_are_those_alone_bit_for_bit(biped_core, begin):
    together = [
        trajectory(biped_core(len(DIFFERENT), threads=threads), begin, scenarios(), 1.0) for threads in (1, 2)
    ]
    assert together[0].tobytes() == together[1].tobytes()
    for k, scenario in enumerate(scenarios()):
        alone = trajectory(biped_core(), begin, [scenario], 1.0)
        assert together[0][:, k].tobytes() == alone[:, 0].tobytes(), scenario.errors
    ends = together[0][-1, :, :2]
    assert len(np.unique(ends.round(9), axis=0)) == len(DIFFERENT)  # the errors do something


def test_nothing_of_an_error_is_left_after_the_next_reset(biped_core, begin):
    core, clean = biped_core(), [Scenario("clean", (PUSH,))]
    expected = trajectory(core, begin, clean, 0.5)
    for errors in DIFFERENT:
        trajectory(core, begin, [Scenario("off", errors=errors)], 0.1)
        assert trajectory(core, begin, clean, 0.5).tobytes() == expected.tobytes()


@pytest.mark.parametrize("errors", DIFFERENT, ids=lambda errors: str(errors.to_dict()))
def test_the_mirrored_scenario_gives_the_mirrored_outcome(biped_core, begin, errors):
    scenario = Scenario("a", (PUSH,), Command(0.1, 0.05), noise_seed=5, errors=errors)
    core, coms = biped_core(), []
    for side in (scenario, scenario.mirrored()):
        begin(core, 0, side)
        com = []
        for _ in range(100):
            step(core)
            com.append(core.simulations.data[0].subtree_com[0].copy())
        coms.append(np.array(com))
    np.testing.assert_allclose(coms[0], coms[1] * [1.0, -1.0, 1.0], atol=1e-6)


def test_windings_warm_as_fast_in_finer_physics(biped_core, begin):
    """Every 2 ms by 2 ms / 40 s of what the squared share of the continuous torque is ahead."""
    core, torques = biped_core(), []
    core.after_physics_step = lambda: torques.append(core.simulations.data[0].ctrl.copy())
    begin(core, 0, Scenario("a", errors=ModelErrors(continuous_torque=0.4), physics=PhysicsOptions(0.0005)))
    step(core)
    warmth, limit = np.zeros(14), 0.4 * biped_model().actuator_forcerange[:, 1]
    for torque in torques:
        warmth += 0.002 / 40.0 * ((torque / limit) ** 2 - warmth)
    np.testing.assert_allclose(core.errors.warmth[0], warmth, rtol=0.01, atol=1e-12)


def test_the_contact_time_is_that_of_all_that_collides():
    model = altered_model(biped(), ModelErrors(collisions=True), PhysicsOptions(contact_time=0.02))
    assert model is not None
    assert set(model.geom_solref[model.geom_contype > 0, 0]) == {0.02}


@pytest.mark.parametrize("name", ["motor_power", "bus_power"])
def test_the_power_of_one_motor_and_that_of_all_are_held_in_a_run(biped_core, begin, name):
    """Torque times the rate at which it acted, of who drives."""
    core, found, watts = biped_core(), [], 10.0
    push = Push((0.0, 300.0, 0.0), 0.1, 0.05)
    begin(core, 0, Scenario("a", (push,), errors=ModelErrors(**{name: watts})))
    data = core.simulations.data[0]
    rates = data.qvel[6:].copy()

    def look():
        found.append(data.ctrl * rates)
        rates[:] = data.qvel[6:]

    core.after_physics_step = look
    for _ in range(20):
        step(core)
    assert not core.gait.failure[0]
    given = np.maximum(found, 0.0)
    if name == "motor_power":
        assert given.max() == pytest.approx(watts)
        assert given.sum(axis=1).max() > 1.1 * watts
    else:
        assert given.sum(axis=1).max() == pytest.approx(watts)


@pytest.mark.parametrize("errors", [{"motor_power": 300.0}, {"bus_power": 300.0}, {"continuous_torque": 0.4}])
def test_any_limit_of_the_drives_alone_makes_a_step_more_than_a_plain_one(errors):
    table = model_errors.no_errors(1)
    model_errors.assign_errors(table, 0, Scenario("a", errors=ModelErrors(**errors)), biped())
    assert (table.mismatched[0], table.physical[0]) == (0, 1)


@pytest.mark.parametrize("errors", [{"trunk_com": (0.01, 0.0, 0.0)}, {"payload": 2.0}])
def test_control_does_not_know_of_what_the_trunk_alone_carries(errors):
    table = model_errors.no_errors(1)
    model_errors.assign_errors(table, 0, Scenario("a", errors=ModelErrors(**errors)), biped())
    assert (table.mismatched[0], table.physical[0]) == (1, 1)


def test_losses_are_those_of_waist_and_legs_not_of_held_joints():
    robot = compiled_robot(ARMS_HELD)
    own = altered_model(robot, ModelErrors(joint_friction=1.0, joint_damping=2.0, armature=0.03))
    assert own is not None
    legs, arms = list(robot.indices.dof[6:]), list(robot.indices.held_dof)
    assert len(arms) == 7
    for name, more in (("dof_frictionloss", 1.0), ("dof_damping", 2.0), ("dof_armature", 0.03)):
        added = getattr(own, name) - getattr(robot.model, name)
        np.testing.assert_allclose(added[legs], more, rtol=1e-12, err_msg=name)
        assert not added[arms].any(), name


def test_a_terrain_that_is_refused_leaves_a_robot_its_errors(monkeypatch):
    def fails(*_):
        raise KeyError("pit")

    table, stairs = model_errors.no_errors(1), ModelErrors(terrain=Stairs(0.0123))
    model_errors.assign_errors(table, 0, Scenario("a", errors=ModelErrors(delay=0.004)), biped())
    monkeypatch.setattr(Stairs, "shape", fails)
    with pytest.raises(InvalidValueError, match="terrain Stairs can't be added to the model: KeyError"):
        model_errors.assign_errors(table, 0, Scenario("b", errors=stairs), biped())
    assert (table.physical[0], table.delay[0]) == (1, 2)
