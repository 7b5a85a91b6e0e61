import math
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.controllers.model.capturability import max_recoverable_force
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, nominal_start
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.pendulum.dynamics import settle
from push_recovery.envs.pendulum.env import PendulumCore, PendulumEpisodes
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from scipy.integrate import solve_ivp

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)


def nominal(command=(0.0, 0.0)):
    gait = nominal_gait(ROBOT, LIMITS, command)
    start = nominal_start(gait, ROBOT.pelvis_width, ROBOT.omega)
    return start, np.array([gait.length, gait.width, gait.duration, 0.0, 0.0, 0.0, 0.0])


def make_core(scenario, hz=100.0, n=1):
    core = PendulumCore(n, ROBOT, LIMITS, hz)
    sign = -1 if scenario.stance_side == "left" else 1
    start, gait = nominal((scenario.command.vx, sign * scenario.command.vy))
    for k in range(n):
        core.reset(k, scenario, start, gait, LIMITS.to_action(gait).astype(float))
    return core


def run(core, gait, cycles):
    for _ in range(cycles):
        core.step(gait[None].repeat(core.n, 0), np.zeros((core.n, 7)))
    return core.state


def test_one_cycle_equals_numerical_integration():
    """x'' = omega^2 (x - cop - j/(mg) theta'') + F/m, theta'' = a; the push begins and ends inside."""
    push = Push((180.0, -90.0, 0.0), 0.013, 0.0042)
    core = make_core(Scenario("x", pushes=(push,)), hz=25.0)
    s = core.state
    before = np.concatenate([s.com[0], s.velocity[0], s.angle[0], s.rate[0]])
    gait = np.array([0.0, 0.2, 0.65, 0.04, -0.03, 6.0, -4.0])
    cop, trunk = np.array([0.04, 0.03]), np.array([6.0, 4.0])  # world frame: left stance mirrors y

    def motion(t, y):
        force = np.array(push.force[:2]) * (0.0042 <= t < 0.0172)
        cmp = cop + ROBOT.trunk_inertia / ROBOT.weight * trunk
        acceleration = ROBOT.omega**2 * (y[0:2] - cmp) + force / ROBOT.mass
        return np.concatenate([y[2:4], acceleration, y[6:8], trunk])

    y = before
    for t0, t1 in ((0.0, 0.0042), (0.0042, 0.0172), (0.0172, 0.04)):
        inside = 0.5 * (t0 + t1)
        span = solve_ivp(lambda t, y, inside=inside: motion(inside, y), (t0, t1), y, rtol=1e-12, atol=1e-14)
        y = span.y[:, -1]
    run(core, gait, 1)
    after = np.concatenate([s.com[0], s.velocity[0], s.angle[0], s.rate[0]])
    assert after == pytest.approx(y, abs=1e-10)


def test_push_estimate_explains_the_motion_of_the_dcm():
    """delta = (xi - (e xi_before - (e - 1) cmp)) / (e - 1), e = exp(omega dt), in a cycle without events."""
    push = Push((180.0, -90.0, 0.0), 0.05, 0.0042)
    core = make_core(Scenario("x", pushes=(push,)), hz=50.0)
    s, grow = core.state, math.exp(ROBOT.omega / 50.0)
    gait = np.array([0.0, 0.2, 0.65, 0.04, -0.03, 6.0, -4.0])
    for cycle in range(4):
        before = s.com[0] + s.velocity[0] / ROBOT.omega
        run(core, gait, 1)
        after = s.com[0] + s.velocity[0] / ROBOT.omega
        delta = (after - (grow * before - (grow - 1.0) * s.cmp[0])) / (grow - 1.0)
        assert s.push[0] == pytest.approx(delta, abs=1e-12)
        assert core.observation[0, 34:36] == pytest.approx(delta * [1, -1], abs=1e-12)  # left stance
        if cycle == 1:  # the push lasts all of it
            assert delta == pytest.approx(np.array([180.0, -90.0]) / (60.0 * ROBOT.omega**2))
        if cycle == 3:
            assert delta == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_touchdown_due_at_the_end_of_a_cycle_happens_in_it():
    core = make_core(Scenario("x"))
    _, gait = nominal()
    run(core, gait, 65)  # T = 0.65 s
    assert core.state.steps[0] == 1
    assert core.observation[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert core.state.side[0] == 1


def test_nominal_gait_closes_after_two_steps():
    core = make_core(Scenario("x", command=Command(0.5, 0.0)))
    _, gait = nominal((0.5, 0.0))
    start = core.observation[0].copy()
    run(core, gait, 130)
    s = core.state
    assert s.steps[0] == 2
    assert s.side[0] == 0
    assert s.stance[0] == pytest.approx([2 * 0.325, 0.0], abs=1e-12)
    error = (core.observation[0] - start)[1:7]
    assert np.abs(error).max() < 1e-11 * math.exp(ROBOT.omega * 1.3) * 100


@pytest.mark.parametrize("hz", [33.0, 100.0, 250.0, 997.0])
@pytest.mark.parametrize("start", [0.123456, GaitEvent(0, "left", 0.37), GaitEvent(1, "right", 0.0)])
def test_impulse_is_exact_at_every_rate_and_moves_the_dcm_as_it_should(hz, start):
    push = Push((35.0, 20.0, 0.0), 0.0777, start)
    core, free = make_core(Scenario("x", pushes=(push,)), hz), make_core(Scenario("y"), hz)
    _, gait = nominal()
    for c in (core, free):
        run(c, gait, round(0.9 * hz))
    assert core.pushes.delivered[0, 0] == pytest.approx(np.array(push.impulse), abs=1e-9)
    s, f = core.state, free.state
    omega, end = ROBOT.omega, s.time[0]
    began = core.pushes.start[0, 0]
    shift = (s.com - f.com)[0] + (s.velocity - f.velocity)[0] / omega
    # int F/(m omega) exp(omega (end - t)) dt over the push
    growth = math.exp(omega * (end - began)) - math.exp(omega * (end - began - push.duration))
    expected = np.array(push.force[:2]) / (ROBOT.mass * omega**2) * growth
    assert shift == pytest.approx(expected, rel=1e-9, abs=1e-10)


def test_outcome_does_not_depend_on_the_control_rate():
    """Exact integration: the same inputs at 20 Hz and at 1000 Hz, with a touchdown inside the cycle."""
    states = []
    for hz, cycles in ((20.0, 14), (1000.0, 700)):
        core = make_core(Scenario("x", pushes=(Push((20.0, 10.0, 0.0), 0.1, 0.21),)), hz)
        s = run(core, nominal()[1], cycles)
        states.append(np.concatenate([s.com[0], s.velocity[0], s.stance[0], [s.step_start[0]]]))
    assert states[0] == pytest.approx(states[1], abs=1e-9)


def test_trunk_stops_inelastically_and_hands_its_momentum_to_the_com():
    core = make_core(Scenario("x"))
    s = core.state
    s.angle[0, 0], s.rate[0, 0] = ROBOT.trunk_angle_max - 0.01, 4.0
    twin = make_core(Scenario("x"))
    gait = nominal()[1]
    run(core, gait, 1), run(twin, gait, 1)
    assert s.angle[0, 0] == ROBOT.trunk_angle_max
    assert s.rate[0, 0] == 0.0
    left = 0.01 - 0.01 / 4.0  # after the stop, the velocity step j rate / (m h) grows like cosh
    kick = ROBOT.trunk_inertia * 4.0 / (ROBOT.mass * ROBOT.com_height)
    assert s.velocity[0, 0] - twin.state.velocity[0, 0] == pytest.approx(
        kick * math.cosh(ROBOT.omega * left), rel=1e-9
    )


def test_pushing_against_the_stop_moves_nothing():
    core, twin = make_core(Scenario("x")), make_core(Scenario("x"))
    for c in (core, twin):
        c.state.angle[0, 1] = -ROBOT.trunk_angle_max
    gait = nominal()[1]
    pressed = gait.copy()
    pressed[6] = 10.0  # canonical, left stance: towards -y of the world
    run(core, pressed, 5), run(twin, gait, 5)
    assert core.state.com[0] == pytest.approx(twin.state.com[0], abs=1e-15)
    assert core.state.angle[0, 1] == -ROBOT.trunk_angle_max


def test_inputs_are_clipped_to_the_sole_and_the_torque():
    core = make_core(Scenario("x"))
    run(core, np.array([0.0, 0.2, 0.65, 9.0, 9.0, 99.0, 0.0]), 1)
    assert core.state.cop[0] == pytest.approx([0.1, -0.05])
    assert core.state.rate[0, 0] == pytest.approx(150.0 / 8.0 * 0.01)


def test_robots_do_not_depend_on_each_other():
    push = Push((40.0, 0.0, 0.0), 0.1, 0.3)
    single, many = make_core(Scenario("x", pushes=(push,))), make_core(Scenario("y"), n=3)
    start, gait = nominal()
    many.reset(1, Scenario("x", pushes=(push,)), start, gait, LIMITS.to_action(gait).astype(float))
    run(single, gait, 80), run(many, gait, 80)
    assert np.array_equal(many.observation[1], single.observation[0])
    assert not np.array_equal(many.observation[0], single.observation[0])


def test_a_reset_looks_at_no_other_robot():
    core, (start, gait) = make_core(Scenario("x"), n=3), nominal()
    seen = core.observation.copy()
    core.observation[:], core.margin[:] = 7.0, 7.0
    core.reset(1, Scenario("x"), start, gait, LIMITS.to_action(gait).astype(float))
    assert core.observation[1].tobytes() == seen[1].tobytes()
    assert (core.observation[[0, 2]] == 7.0).all()
    assert (core.margin == 7.0).tolist() == [True, False, True]


ENV_ID = "PushRecovery/Pendulum-v0"


@pytest.fixture
def env():
    made = gym.make(ENV_ID)
    yield made
    made.close()


def play(env, policy, scenario):
    obs, info = env.reset(options={"scenario": scenario})
    trace, total, done = [obs], 0.0, False
    while not done:
        obs, reward, terminated, truncated, info = env.step(policy.predict(obs)[0])
        trace.append(obs)
        total += reward
        done = terminated or truncated
        assert reward == pytest.approx(sum(info["reward_terms"].values()))
    return np.array(trace), total, terminated, info


def pushed(force, psi_deg, side="left", **kw):
    return Scenario("p", (polar_push(force, math.radians(psi_deg), 0.1, GaitEvent(4, side)),), **kw)


def test_both_checkers_pass():
    with warnings.catch_warnings():
        warnings.simplefilter("error", category=DeprecationWarning)
        check_env(gym.make(ENV_ID, render_mode="rgb_array").unwrapped)
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker")
    sb3.check_env(gym.make(ENV_ID).unwrapped)


def test_vector_form_and_spec():
    envs = gym.make_vec(ENV_ID, num_envs=2)
    obs, _ = envs.reset(seed=1)
    assert obs.shape == (2, 36)
    assert "autoreset_mode" in envs.metadata
    envs.close()
    env = gym.make(ENV_ID, control_hz=50.0, push_distribution={"impulse_max": 20.0})
    assert env.spec is not None
    assert env.spec.to_json()
    assert env.unwrapped.push_distribution.impulse_max == 20.0
    env.reset(seed=0)
    assert env.step(np.zeros(7, np.float32))[4]["time"] == pytest.approx(0.02)


@pytest.mark.parametrize(
    "command", [(0.0, 0.0), (0.5, 0.0), (-0.25, 0.0), (0.0, 0.2), (0.0, -0.2), (0.3, 0.1)]
)
@pytest.mark.parametrize("name", ["stage-1", "two-stage", "two-stage-paper"])
def test_walks_at_the_commanded_speed_and_counts_as_recovered(env, name, command):
    duration = 4.0 if name == "two-stage-paper" else 10.0
    _, _, fell, info = play(
        env, make_policy(name), Scenario("w", command=Command(*command), duration=duration)
    )
    assert not fell
    assert info["recovered_at"] is not None
    assert env.unwrapped.monitor.state.speed_error[0] < 0.03
    assert env.unwrapped.monitor.state.error[0].max() < 0.01


def test_bit_identical_in_any_order(env):
    policy = make_policy("two-stage")
    first = play(env, policy, pushed(300, -60))
    play(env, policy, pushed(700, 20))
    again = play(gym.make(ENV_ID), make_policy("two-stage"), pushed(300, -60))
    assert np.array_equal(first[0], again[0])
    assert first[1] == again[1]


def test_mirrored_scenario_gives_the_mirrored_outcome(env):
    policy = make_policy("two-stage")
    scenario = pushed(350, -40, command=Command(0.2, 0.1))
    one = play(env, policy, scenario)
    com = env.unwrapped.core.state.com[0].copy()
    two = play(env, policy, scenario.mirrored())
    assert two[0] == pytest.approx(one[0], abs=1e-9)
    assert env.unwrapped.core.state.com[0] == pytest.approx(com * [1, -1], abs=1e-9)


def test_push_is_delivered_whole_and_forgotten_after_reset(env):
    scenario = pushed(200, 30)
    _, _, _, info = play(env, make_policy("two-stage"), scenario)
    core = env.unwrapped.core
    assert core.pushes.delivered[0, 0] == pytest.approx(np.array(scenario.pushes[0].impulse), abs=1e-9)
    assert info["push"]["start"] == pytest.approx(4 * 0.65, abs=1e-3)
    assert info["push"]["impulse_per_kg"] == pytest.approx(20 / 60)
    assert info["time"] == pytest.approx(4 * 0.65 + 0.1 + 4.0, abs=0.011)
    quiet = play(env, make_policy("two-stage"), Scenario("q", duration=5.0))[0]
    fresh = play(gym.make(ENV_ID), make_policy("two-stage"), Scenario("q", duration=5.0))[0]
    assert np.array_equal(quiet, fresh)


@pytest.mark.parametrize("psi", range(0, 360, 45))
def test_two_stage_beats_the_point_foot_and_no_push_beyond_the_limit_is_survived(env, psi):
    robot = RobotModel()
    limit = max_recoverable_force(robot, math.radians(psi))
    point = max_recoverable_force(robot, math.radians(psi), foot=False, flywheel=False)
    policy = make_policy("two-stage")
    _, _, fell, info = play(env, policy, pushed(0.8 * limit, psi))
    assert not fell
    assert info["recovered_at"] is not None
    assert play(env, policy, pushed(1.03 * limit, psi))[2]
    stage_1 = make_policy("stage-1")
    assert not play(env, stage_1, pushed(0.97 * point, psi))[2]
    assert play(env, stage_1, pushed(1.03 * point, psi))[2]


def test_a_fall_has_a_reason_and_no_recovery(env):
    trace, _, fell, info = play(env, make_policy("passive"), pushed(300, 90))
    assert fell
    assert info["failure_reason"] == "dcm_diverged"
    assert info["recovered_at"] is None
    assert info["capture_margin"] < 0
    assert np.isfinite(trace).all()
    with pytest.raises(InvalidValueError, match="reset"):
        env.unwrapped.step(np.zeros(7, np.float32))


def test_capture_margin_never_rises_from_below_zero_without_a_push(env):
    """The margin is exact: once negative, no policy gets out of it."""
    for name, seed in (("random", 0), ("stage-1", 1), ("two-stage", 2)):
        policy = make_policy(name)
        obs, info = env.reset(seed=seed, options={"scenario": pushed(420, 90)})
        lost, done = False, False
        while not done:
            obs, _, terminated, truncated, info = env.step(policy.predict(obs)[0])
            done = terminated or truncated
            if lost:
                assert info["capture_margin"] < 1e-9
            lost = lost or (info["capture_margin"] < -1e-9 and info["time"] > 2.75)


@pytest.mark.parametrize(
    "bad", [np.zeros(6), np.full(7, np.nan), np.full(7, np.inf), "abc", None, np.zeros((1, 7))]
)
def test_bad_actions(env, bad):
    env.reset(seed=0)
    with pytest.raises(InvalidValueError, match="action"):
        env.unwrapped.step(bad)


@pytest.mark.parametrize(
    ("kwargs", "error"),
    [
        ({"control_hz": 0}, InvalidValueError),
        ({"control_hz": math.nan}, InvalidValueError),
        ({"preset": "nope"}, UnknownNameError),
        ({"render_mode": "ansi"}, UnknownNameError),
        ({"push_distribution": {"impulse": 3}}, PushRecoveryError),
    ],
)
def test_bad_arguments(kwargs, error):
    from push_recovery.envs.pendulum.env import PendulumEnv

    with pytest.raises(error):
        PendulumEnv(**kwargs)


@pytest.mark.parametrize("options", [{"scenario": "x"}, {"scenaro": None}])
def test_bad_options(env, options):
    with pytest.raises(PushRecoveryError):
        env.unwrapped.reset(options=options)


def test_step_before_reset():
    from push_recovery.envs.pendulum.env import PendulumEnv

    with pytest.raises(InvalidValueError, match="reset"):
        PendulumEnv().step(np.zeros(7))


def test_renders_without_a_display():
    env = gym.make(ENV_ID, render_mode="rgb_array")
    env.reset(options={"scenario": pushed(200, 0)})
    first = env.render()
    for _ in range(30):
        env.step(np.zeros(7, np.float32))
    assert first.shape == (480, 640, 3)
    assert first.dtype == np.uint8
    assert not np.array_equal(first, env.render())


@pytest.mark.parametrize(("axis", "com"), [(0, (0.05, -0.1)), (1, (0.0, 0.0))])
@pytest.mark.parametrize(("rate", "settles"), [(1.17, False), (-1.17, True)])
def test_a_trunk_that_swings_on_counts_before_it_stands(axis, com, rate, settles):
    """0.2548 m (1 - exp(-3.502 x 1.17 / 18.75)) = 5 cm; the hull ends at 8 cm ahead and 3 cm aside."""
    core = PendulumCore(1, ROBOT, LIMITS)
    state = core.state
    state.lift[0], state.com[0], state.rate[0, axis] = (0.0, -0.2), com, rate
    settle(state, 0, 1.0, core.physics)
    assert bool(state.standing[0]) == settles


def test_any_body_that_is_pushed_is_the_pendulum():
    ends = []
    for body in ("pelvis", "link:left_elbow_joint"):
        episodes = PendulumEpisodes(1)
        episodes.begin(0, Scenario("arm", (Push((60.0, 0.0, 0.0), 0.1, 0.0, body),)))
        for _ in range(5):
            episodes.step(np.zeros((1, 7), np.float32))
        ends.append(episodes.core.truth.copy())
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize(("beyond", "why"), [(0.09, ""), (0.11, "dcm_diverged")])
def test_a_stander_is_lost_10_cm_beyond_what_can_be_caught(beyond, why):
    episodes = PendulumEpisodes(1)
    episodes.begin(0, Scenario("a", command=Command(stand=True)))
    core = episodes.core
    core.state.com[0, 0] = 1.0
    for _ in range(40):
        core._look(0, 1)
        core.state.com[0, 0] += core.margin[0] + beyond
    core.state.failure[0] = 0
    core._look(0, 1)
    assert core.margin[0] == pytest.approx(-beyond, abs=1e-6)
    assert episodes.failures[episodes.failure()[0]] == why
