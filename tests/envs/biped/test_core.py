"""The biped in the loop: physics against the pendulum, repeatability, independence, mirror symmetry."""

import copy
import json
import pickle

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.observation import PUSH_ESTIMATE
from push_recovery.controllers.policies.residual import make_gate
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.settings import PresetFile
from push_recovery.controllers.whole_body.gait_machine import FAILURES
from push_recovery.controllers.whole_body.kinematics import FOOT_BODY, PELVIS, com_velocity
from push_recovery.envs.biped.core import (
    BIPED,
    BIPED_LIMITS,
    SECTIONS,
    BipedCore,
    BipedSettings,
    biped_settings,
)
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.biped.period import substeps
from push_recovery.envs.robots.biped import PLAN, biped_model
from push_recovery.envs.scenario.model_errors import CONTROL_STEP
from push_recovery.envs.scenario.push import GaitEvent, Kick, Push, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario


def preset(path, **sections):
    PresetFile("biped", {}, {}, sections).save(path)
    return str(path)


def walk(episodes, periods=60):
    """Observations of a pushed robot under the two-stage planner."""
    episodes.begin(0, Scenario("push", (polar_push(150.0, 2.0, 0.1, 0.1),)))
    policy = make_policy("two-stage", episodes.robot, BIPED_LIMITS, "biped")
    seen = []
    for _ in range(periods):
        seen.append(episodes.core.observation[0].copy())
        episodes.step(policy.predict(seen[-1])[0][None])
    return np.array(seen)


def test_changes_take_hold_and_leave_the_rest():
    changed = BipedSettings().changed({"gains": {"swing_kp": 1.0}, "limits": {"length_max": 0.3}})
    before, after = BipedSettings().to_dict(), changed.to_dict()
    assert after["gains"].pop("swing_kp") == 1.0
    assert after["limits"].pop("length_max") == 0.3
    assert before["gains"].pop("swing_kp") != 1.0
    before["limits"].pop("length_max")
    assert after == before
    assert BipedSettings().changed(BipedSettings().to_dict()) == BipedSettings()


def test_without_changes_the_robot_is_that_of_the_environment(tmp_path):
    plain = walk(BipedEpisodes(1))
    assert np.array_equal(walk(BipedEpisodes(1)), plain)
    everything = preset(tmp_path / "all.json", **BipedSettings().to_dict())
    assert np.array_equal(walk(BipedEpisodes(1, preset=everything)), plain)


@pytest.mark.parametrize(
    ("section", "field", "value"),
    [("gait", "apex", 0.1), ("gains", "swing_kp", 200.0), ("bounds", "cop_x_max", 0.03)],
)
def test_a_change_reaches_the_robot(tmp_path, section, field, value):
    changed = BipedEpisodes(1, preset=preset(tmp_path / "one.json", **{section: {field: value}}))
    assert not np.array_equal(walk(changed, 30), walk(BipedEpisodes(1), 30))


def test_limits_are_the_action_box_and_the_nominal_gait(tmp_path):
    episodes = BipedEpisodes(1, preset=preset(tmp_path / "box.json", limits={"duration_max": 0.7}))
    assert episodes.limits.duration_max == 0.7
    assert episodes.nominal(0.0, 0.0).duration > BipedEpisodes(1).nominal(0.0, 0.0).duration
    lowest, highest = episodes.gaits(np.array([[-1.0] * 7, [1.0] * 7], np.float32))
    assert (lowest[2], highest[2]) == (BIPED_LIMITS.duration_min, 0.7)


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"gain": {}}, r"^unknown section of the biped's settings 'gain'; did you mean 'gains'\?"),
        ({"gains": {"swing": 1.0}}, r"^unknown field of the biped's gains 'swing'"),
        ({"gait": {"mass": 1.0}}, r"^unknown field of the biped's gait 'mass'"),
        ({"gait": {"apex": "high"}}, r"^apex of the biped's gait must be finite and >= 0, got 'high'$"),
        ({"gains": {"swing_kp": -1.0}}, r"^swing_kp of the biped's gains must be finite and >= 0, got -1.0$"),
        ({"limits": {"length_max": -1.0}}, r"^GaitLimits.length_min must be below length_max"),
    ],
)
def test_bad_settings_are_refused(tmp_path, sections, message):
    with pytest.raises((InvalidValueError, UnknownNameError), match=message):
        biped_settings(preset(tmp_path / "bad.json", **sections))


def test_sections_are_plain_json():
    assert set(SECTIONS) == set(json.loads(json.dumps(BipedSettings().to_dict())))


MODEL = biped_model()
POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")


def step(core, policy=POLICY) -> None:
    action = policy.predict(core.observation)[0]
    core.step(BIPED_LIMITS.from_action(action), action.astype(np.float64))


def contact_wrench(data: mujoco.MjData, stance: int) -> tuple[np.ndarray, float]:
    """Wrench (6,) about the stance sole, and the normal force of all other contacts [N]."""
    wrench, others, force = np.zeros(6), 0.0, np.empty(6)
    sole = data.site(PLAN.soles[stance]).xpos
    for i, contact in enumerate(data.contact):
        mujoco.mj_contactForce(MODEL, data, i, force)
        f = contact.frame.reshape(3, 3).T @ force[:3]
        if FOOT_BODY[stance] in MODEL.geom_bodyid[contact.geom]:
            wrench += [*f, *np.cross(contact.pos - sole, f)]
        else:
            others += force[0]
    return wrench, others


@pytest.fixture(scope="module")
def single_support(biped_core, begin):
    """CoM acceleration, the pendulum's, announced and true wrench of a robot walking undisturbed for 3 s."""
    core = biped_core(1, 500.0)
    gait = begin(core, 0, Scenario("walk", command=Command(0.2, 0.05)))[None].copy()
    action = core.previous_action.copy()
    data, gain = mujoco.MjData(MODEL), BIPED.cmp_per_trunk_acceleration
    rows = []
    for tick in range(1500):
        if tick % 5 == 0:
            action = POLICY.predict(core.observation)[0].astype(np.float64)
            gait[:] = BIPED_LIMITS.from_action(action)
        qpos, qvel = core.physics.qpos[0].copy(), core.physics.qvel[0].copy()
        com, before = core.physics.com[0, 0].copy(), np.array(com_velocity(core.physics, 0))
        core.step(gait, action)
        acceleration = (com_velocity(core.physics, 0) - before) / CONTROL_STEP
        stance, plan = int(core.gait.stance[0]), core.gait.plan[0]
        mujoco.mj_resetData(MODEL, data)
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, core.physics.ctrl[0]
        mujoco.mj_forward(MODEL, data)
        wrench, others = contact_wrench(data, stance)
        if core.gait.elapsed[0] < 0.05 or others > 0.0:
            continue
        sign = np.array([1.0, -1.0 if stance == 0 else 1.0])
        cmp = data.site(PLAN.soles[stance]).xpos[:2] + sign * (plan[3:5] + gain * plan[5:7])
        pendulum = BIPED.omega**2 * (com[:2] - cmp)
        rows.append([*acceleration[:2], *pendulum, *core.gait.wrench[0], *wrench])
    assert core.gait.failure[0] == 0
    return np.array(rows)


def test_the_com_moves_as_the_pendulum(single_support):
    """Simulated acceleration = omega^2 (com - cmp) within 2 %."""
    assert len(single_support) > 750  # most of the walk is single support
    error = single_support[:, 0:2] - single_support[:, 2:4]
    assert np.sqrt(np.mean(error**2)) < 0.02 * np.sqrt(np.mean(single_support[:, 2:4] ** 2))


def test_the_wrench_announced_is_the_contact_wrench(single_support):
    announced, true = single_support[:, 4:10], single_support[:, 10:16]
    force = np.linalg.norm(announced[:, :3] - true[:, :3], axis=1)
    assert force.max() < 0.03 * BIPED.weight
    assert np.sqrt(np.mean(force**2)) < 0.005 * BIPED.weight
    moment = np.linalg.norm(announced[:, 3:5] - true[:, 3:5], axis=1)
    assert moment.max() < 0.005 * BIPED.weight  # a CoP within 5 mm
    assert np.abs(announced[:, 5] - true[:, 5]).max() < 0.5  # [N m]


@pytest.mark.parametrize("name", ["two-stage", "random"])
def test_torques_keep_their_limits(biped_core, begin, name):
    core, limit = biped_core(), MODEL.actuator_forcerange[:, 1]
    push = Push((100.0, 400.0, 0.0), 0.1, GaitEvent(1, "right", 0.2))
    begin(core, 0, Scenario("hard", (push,)))
    policy = make_policy(name, BIPED, BIPED_LIMITS, "biped")
    data = mujoco.MjData(MODEL)
    while core.gait.failure[0] == 0 and core.gait.time[0] < 2.0:
        step(core, policy)
        data.qpos[:], data.qvel[:] = core.physics.qpos[0], core.physics.qvel[0]
        data.ctrl[:] = core.physics.ctrl[0]
        mujoco.mj_forward(MODEL, data)
        assert np.all(np.abs(data.actuator_force) <= limit)  # what acts
        # what is asked: the bounds are soft where the tasks are impossible
        assert name == "random" or np.all(np.abs(core.physics.ctrl[0]) <= 1.02 * limit)


SCENARIOS = (
    Scenario("a", (Push((60.0, 90.0, 0.0), 0.1, GaitEvent(2, "left", 0.3)),), Command(0.2, 0.0)),
    Scenario("b", stance_side="right"),
    Scenario(
        "c",
        (Push((-80.0, 20.0, 0.0), 0.1, 0.5, "trunk"), Push((0.0, 60.0, 0.0), 0.05, 1.4)),
        Command(0.0, 0.1),
    ),
)


def trajectory(core, begin, scenarios, seconds: float = 2.5) -> np.ndarray:
    """Full MuJoCo state and observation at every planning period, (ticks, n, 75)."""
    for k, scenario in enumerate(scenarios):
        begin(core, k, scenario)
    out = []
    for _ in range(round(seconds * 100)):
        step(core)
        out.append(np.concatenate([core.physics.qpos, core.physics.qvel, core.observation], axis=1))
    return np.array(out)


@pytest.mark.parametrize(("n", "threads"), [(3, 1), (3, 2), (16, 2), (16, 5)])
def test_robots_together_are_those_alone_bit_for_bit(biped_core, begin, n, threads):
    scenarios = [SCENARIOS[k % 3] for k in range(n)]
    together = trajectory(biped_core(n, threads=threads), begin, scenarios, 1.8)
    for k, scenario in enumerate(SCENARIOS):
        alone = trajectory(biped_core(), begin, (scenario,), 1.8)
        for twin in range(k, n, 3):
            assert together[:, twin].tobytes() == alone[:, 0].tobytes()


def test_a_closer_look_changes_nothing(biped_core, begin):
    looks, cores = [], (biped_core(), biped_core())
    cores[0].after_physics_step = lambda: looks.append(cores[0].physics.qpos[0].copy())
    first, second = (trajectory(core, begin, SCENARIOS[:1], 0.3) for core in cores)
    assert first.tobytes() == second.tobytes()
    np.testing.assert_array_equal(
        np.array(looks)[cores[0].substeps - 1 :: cores[0].substeps], first[:, 0, :21]
    )


def test_the_push_estimate_is_what_the_floor_s_impulse_leaves_of_the_momentum(biped_core, begin):
    """(m (v - v_before) - J) / (m omega^2 t), v the CoM's and J of MuJoCo's contacts; a reset starts anew."""
    core = biped_core()
    begin(core, 0, Scenario("before", (Push((300.0, 0.0, 0.0), 0.1, 0.0),)))
    for _ in range(7):
        step(core)
    core.contacts.impulse[0], core.contacts.time[0] = (40.0, -30.0, 500.0), 0.004
    begin(core, 0, Scenario("pushed", (Push((90.0, 60.0, 0.0), 0.1, 0.0),)))
    model, data, impulse = core.simulations.models[0], core.simulations.data[0], np.zeros(2)

    def velocity():
        mujoco.mj_subtreeVel(model, data)
        return data.subtree_linvel[1, :2].copy()

    def look():
        impulse[:] += 0.002 * data.qfrc_constraint[:2]

    core.after_physics_step = look
    for _ in range(3):
        before = velocity()
        impulse[:] = 0.0
        step(core)
        change = BIPED.mass * (velocity() - before)
        expected = (change - impulse) / (BIPED.mass * BIPED.omega**2 * 0.01)
        seen = core.truth[0, PUSH_ESTIMATE]
        np.testing.assert_allclose(np.abs(seen), np.abs(expected), rtol=1e-6)  # the frame is mirrored
        np.testing.assert_allclose(seen[0], 90.0 / (BIPED.mass * BIPED.omega**2), rtol=0.02)


def test_a_fallen_robot_rests_until_its_reset(biped_core, begin):
    core, push = biped_core(), Push((0.0, 3000.0, 0.0), 0.1, 0.2)
    begin(core, 0, Scenario("a", (push,)))
    for _ in range(300):
        step(core)
    assert core.gait.failure[0] != 0
    before = core.physics.qpos[0].copy(), core.observation[0, :25].copy()
    step(core)
    np.testing.assert_array_equal(core.physics.qpos[0], before[0])
    np.testing.assert_array_equal(core.observation[0, :25], before[1])
    assert trajectory(core, begin, SCENARIOS[1:2], 0.5).tobytes() == (
        trajectory(biped_core(), begin, SCENARIOS[1:2], 0.5).tobytes()
    )


def test_a_fallen_robot_takes_no_kick(biped_core, begin):
    """Its time has stopped: the kick is due at the moment of the fall."""
    core = biped_core()
    begin(core, 0, Scenario("a", (Push((0.0, 3000.0, 0.0), 0.1, 0.1),)))
    for _ in range(120):
        step(core)
    assert core.gait.failure[0] != 0
    core.kicks.assign(0, (Kick((1.0, 0.5, 0.0), core.gait.time.item(0)),))
    before = core.physics.qvel[0].copy(), core.simulations.data[0].qvel.copy()
    for _ in range(2):
        step(core)
    assert core.kicks.done[0] == 1
    np.testing.assert_array_equal(core.physics.qvel[0], before[0])
    np.testing.assert_array_equal(core.simulations.data[0].qvel, before[1])


def test_a_state_that_is_no_number_is_a_failure(biped_core, begin, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warning to a file
    core = biped_core()
    begin(core, 0, SCENARIOS[1])
    core.simulations.data[0].qvel[3] = np.nan
    core.simulations.data[0].qpos[2] = np.nan
    step(core)
    assert FAILURES[core.gait.failure[0]] == "not_finite"


def test_an_episode_repeats_bit_for_bit_whatever_came_before(biped_core, begin):
    core = biped_core()
    first = trajectory(core, begin, SCENARIOS[2:])
    trajectory(core, begin, SCENARIOS[:1], 0.8)
    assert trajectory(core, begin, SCENARIOS[2:]).tobytes() == first.tobytes()


def test_resetting_one_robot_leaves_the_others_alone(biped_core, begin):
    core, alone = biped_core(2), biped_core()
    begin(core, 0, SCENARIOS[0])
    begin(core, 1, SCENARIOS[1])
    begin(alone, 0, SCENARIOS[0])
    for tick in range(120):
        if tick == 55:
            begin(core, 1, SCENARIOS[2])  # more pushes than before: the arrays grow
        step(core)
        step(alone)
        assert core.physics.qpos[0].tobytes() == alone.physics.qpos[0].tobytes()
    np.testing.assert_allclose(core.pushes.delivered[0, 0], alone.pushes.delivered[0, 0], atol=0)


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.id)
def test_the_mirrored_scenario_gives_the_mirrored_outcome(biped_core, begin, scenario):
    core, coms, ends = biped_core(), [], []
    for side in (scenario, scenario.mirrored()):
        begin(core, 0, side)
        com = []
        for _ in range(250):
            step(core)
            com.append(core.physics.com[0, 0].copy())
        coms.append(np.array(com))
        ends.append((core.gait.failure[0], core.gait.steps[0], 1 - core.gait.stance[0]))
    np.testing.assert_allclose(coms[0], coms[1] * [1.0, -1.0, 1.0], atol=1e-6)
    assert ends[0][:2] == ends[1][:2]
    assert ends[0][2] != ends[1][2]


def test_a_robot_begins_on_level_feet_with_the_com_of_the_pendulum(biped_core, begin):
    core = biped_core()
    for scenario in SCENARIOS:
        begin(core, 0, scenario)
        np.testing.assert_allclose(core.physics.xmat[0, PELVIS].reshape(3, 3), np.eye(3), atol=1e-12)
        np.testing.assert_allclose(core.physics.com[0, 0, 2], BIPED.com_height, atol=1e-9)
        assert core.gait.time[0] == core.gait.elapsed[0] == core.gait.steps[0] == 0


@pytest.mark.parametrize(("rate", "steps"), [(500, 1), (250.0, 2), (100.0, 5), (62.5, 8), (20.0, 25)])
def test_rates_that_divide_the_physics_rate(rate, steps):
    assert substeps(rate) == steps


def test_a_copy_of_a_biped_is_refused():
    core = BipedCore(1, BIPED, BIPED_LIMITS)
    for copies in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(
            InvalidValueError, match="a biped cannot be copied or pickled; make a new environment"
        ):
            copies(core)


def test_robots_without_a_state_take_no_step(begin):
    core, nothing = BipedCore(3, BIPED, BIPED_LIMITS), np.zeros((3, 7))
    begin(core, 1, Scenario("walk"))
    with pytest.raises(InvalidValueError, match=r"robots \[0, 2\] have no state yet.* the 3 before"):
        core.step(nothing, nothing)
    assert core.gait.time.tolist() == [0.0, 0.0, 0.0]
    for k in (0, 2):
        begin(core, k, Scenario("walk"))
    step(core)
    assert core.gait.time.tolist() == [core.substeps * CONTROL_STEP] * 3


@pytest.mark.parametrize("turn", [0.6, -0.6])
def test_the_gate_of_corrections_stays_shut_on_unpushed_walks_but_for_fast_turning_starts(turn):
    """Unpushed, the DCM is within 24 mm of the nominal gait; only the start of a fast turn is off by more."""
    walks = [(-0.25, -0.2), (0.0, 0.0), (0.3, -0.2), (0.5, -0.2), (0.5, 0.0), (0.5, 0.2)]
    episodes = BipedEpisodes(len(walks))
    planner = make_policy("two-stage", episodes.robot, episodes.limits, "biped")
    errors = make_gate(planner, episodes.robot, episodes.limits, (0.0, 1.0))  # opens by the error itself
    for k, (vx, vy) in enumerate(walks):
        episodes.begin(k, Scenario(f"walk-{k}", command=Command(vx, vy, turn), duration=9.0))
    seen = []
    for _ in range(400):
        seen.append(errors(episodes.seen)[:, 0])
        episodes.step(planner.predict(episodes.seen)[0])
    late = np.array(seen)[40:].max(0)
    assert (late < 0.024).all()
    assert late.max() > 0.005  # it sways
