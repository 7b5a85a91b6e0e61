"""Double support in the pendulum: both feet on the floor for the first 0.1 s of every step."""

import math

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.model.capturability import capture_margin
from push_recovery.controllers.model.nominal_gait import nominal_start, step_start_dcm, strip, transfer_mean
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.pendulum.env import PendulumEnv
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from scipy.integrate import solve_ivp

import push_recovery  # noqa: F401

D = 0.1
POLICY = make_policy("two-stage", preset="double-support")


def walk(env, scenario, policy=POLICY, steps=10**6):
    """Yield (observation before, info after) of every period until the end or so many steps."""
    obs, _ = env.reset(options={"scenario": scenario})
    ended = False
    while not ended and env.core.state.steps[0] < steps:
        before = obs
        obs, _, fell, over, info = env.step(policy.predict(obs)[0])
        ended = fell or over
        yield before, info


def pushed(force, psi, fraction=0.0, side="left"):
    step = 2 if side == "left" else 3
    push = polar_push(force, math.radians(psi), 0.1, GaitEvent(step, side, fraction))
    return Scenario(f"{force}-{psi}", (push,))


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.5, 0.0), (0.0, 0.2)])
def test_nominal_gait_is_kept_for_20_steps(velocity):
    env = gym.make("PushRecovery/Pendulum-v0", preset="double-support").unwrapped
    assert isinstance(env, PendulumEnv)
    state, feet = env.core.state, []
    for _, info in walk(env, Scenario("x", command=Command(*velocity), duration=20.0), steps=20):
        if not feet or np.any(state.stance[0] != feet[-1]):
            feet.append(state.stance[0].copy())
            sign = -1.0 if info["stance_side"] == "left" else 1.0
            gait = env.episodes.nominal(velocity[0], sign * velocity[1])
            start = np.array(step_start_dcm(gait, 0.2, env.robot.omega, 0.0, D))
            if len(feet) > 1:
                assert (info["dcm"] - feet[-1]) * [1, sign] == pytest.approx(start, abs=1e-3)
                wanted = feet[-2] + [gait.length, sign * gait.width]
        if len(feet) > 2:
            before = env.episodes.nominal(velocity[0], -sign * velocity[1])
            wanted = feet[-2] + [before.length, -sign * before.width]
            assert feet[-1] == pytest.approx(wanted, abs=1e-3)
    assert state.steps[0] == 20
    assert info["recovered_at"] == pytest.approx(3 * gait.duration, abs=1e-6)


def test_start_is_on_the_periodic_orbit_of_the_linear_transfer():
    """com'' = omega^2 (com - z): two steps of different width lead back to the CoM of the start."""
    env = PendulumEnv(preset="double-support")
    omega, feet = (
        env.robot.omega,
        {1.0: env.episodes.nominal(0.3, 0.1), -1.0: env.episodes.nominal(0.3, -0.1)},
    )
    first = nominal_start(feet[1.0], 0.2, omega, 0.0, D)
    y = np.concatenate([first.com, first.com_velocity])
    for sign in (1.0, -1.0):
        gait, start = feet[sign], nominal_start(feet[sign], 0.2, omega, 0.0, D)
        assert y == pytest.approx(np.concatenate([start.com, start.com_velocity]), abs=1e-8)

        def motion(t, y, other=start.swing):
            return np.concatenate([y[2:], omega**2 * (y[:2] - other * max(1.0 - t / D, 0.0))])

        for span in ((0.0, D), (D, gait.duration)):
            y = solve_ivp(motion, span, y, rtol=1e-11, atol=1e-13).y[:, -1]
        y = (y - [gait.length, gait.width, 0.0, 0.0]) * [1.0, -1.0, 1.0, -1.0]
    assert y == pytest.approx(np.concatenate([first.com, first.com_velocity]), abs=1e-7)


def test_foot_that_stood_stays_on_the_floor_until_lift_off():
    env = PendulumEnv(preset="double-support")
    lifted = []
    for obs, info in walk(env, Scenario("x", duration=1.3)):
        both = obs[0] < D - 1e-9
        assert obs[24] == float(both)
        if both:
            assert obs[9:15] == pytest.approx([0.0, 0.2, 0.0, 0.0, 0.0, 0.0], abs=1e-6)
        else:
            lifted.append(obs[11])
        now = env.core.observation[0]
        assert info["contacts"] == {
            "left": info["stance_side"] == "left" or bool(now[24]),
            "right": info["stance_side"] == "right" or bool(now[24]),
        }
    assert max(lifted) == pytest.approx(0.06, abs=1e-3)  # in the middle of single support


@pytest.mark.parametrize(("force", "psi"), [(650, -90), (1100, -30), (700, 40), (450, 90), (900, 180)])
def test_cop_never_leaves_the_soles_and_the_push_is_recovered(force, psi):
    env = PendulumEnv(preset="double-support")
    state, robot, beyond = env.core.state, env.robot, 0
    half = np.array([robot.foot_length, robot.foot_width]) / 2
    for obs, info in walk(env, pushed(force, psi)):
        if state.steps[0] and state.time[0] - state.step_start[0] < 0.01:
            continue  # touchdown within the period
        sign = np.array([1.0, -1.0 if state.side[0] == 0 else 1.0])
        cop = sign * (info["cop"] - state.stance[0])
        other = obs[9:11] if obs[0] < D - 0.01 + 1e-6 else np.zeros(2)
        assert np.all(cop <= np.maximum(other, 0.0) + half + 1e-12)
        assert np.all(cop >= np.minimum(other, 0.0) - half - 1e-12)
        normal_x, normal_y, width = strip(*other, *half)
        assert abs(normal_x * cop[0] + normal_y * cop[1]) <= width + 1e-12
        beyond += bool(np.any(np.abs(cop) > half + 1e-6))
    assert info["recovered_at"] is not None
    assert beyond > 5  # of the sole alone


def test_left_and_right_are_one_problem():
    """The same push in mirror image, from a start on the other foot."""
    seen = []
    for side, psi in (("left", -60.0), ("right", 60.0)):
        push = polar_push(700.0, math.radians(psi), 0.1, GaitEvent(2, side, 0.0))
        env = PendulumEnv(preset="double-support")
        seen.append([obs for obs, _ in walk(env, Scenario("x", (push,), stance_side=side, duration=4.0))])
    np.testing.assert_array_equal(seen[0], seen[1])


@pytest.mark.parametrize(("entry", "wide"), [(1.0, 0.25), (-1.0, -0.05)])
def test_cop_is_brought_to_the_sole_when_the_foot_lifts_within_a_period(entry, wide):
    """At 31 Hz the fourth period begins with both feet on the floor and ends with one."""
    env = PendulumEnv(preset="double-support", control_hz=31.0)
    env.reset(options={"scenario": Scenario("x")})
    action = np.array([0.0, 0.0, 0.0, 0.0, entry, 0.0, 0.0], np.float32)
    state, omega, dt = env.core.state, env.robot.omega, 1.0 / 31.0
    for k in range(4):
        before = -(state.com[0, 1] + state.velocity[0, 1] / omega)  # left stance: canonical y is -y
        info = env.step(action)[4]
        wide_span = min(max(D - k * dt, 0.0), dt)
        dcm = wide + math.exp(omega * wide_span) * (before - wide)
        sole = math.copysign(0.05, wide)
        dcm = sole + math.exp(omega * (dt - wide_span)) * (dcm - sole)
        assert -info["dcm"][1] == pytest.approx(dcm, abs=1e-9)
        assert -info["cop"][1] == pytest.approx(sole if k == 3 else wide, abs=1e-9)


def test_touchdown_within_a_period_leads_the_cop_off_as_the_transfer_would():
    """T = 0.6437 s: the rest of the period the CoP makes the transfer's mean, so that the DCM is nominal."""
    env = PendulumEnv(preset="double-support")
    env.reset(options={"scenario": Scenario("x")})
    gait = np.array([0.0, 0.2, 0.6437, 0.0, 0.0, 0.0, 0.0])
    action = env.limits.to_action(gait)
    for _ in range(64):
        env.step(action)
    state, omega = env.core.state, env.robot.omega
    before = state.com[0] + state.velocity[0] / omega
    info = env.step(action)[4]
    assert state.steps[0] == 1
    left = float(env.core.observation[0, 0])
    assert left == pytest.approx(0.0063, abs=1e-6)
    share = transfer_mean(0.0, left, D, omega)
    assert info["cop"] == pytest.approx(state.stance[0] * (1.0 - share), abs=1e-12)  # the old foot is at 0
    dcm = before * math.exp(omega * (0.01 - left))
    dcm = info["cop"] + math.exp(omega * left) * (dcm - info["cop"])
    assert info["dcm"] == pytest.approx(dcm, abs=1e-9)


def test_capture_margin_counts_what_the_hull_still_gives():
    """Towards the other foot, p_y = 0.2 m, the bound moves by p_y (1 - exp(-omega (d - t)))."""
    env = PendulumEnv(preset="double-support")
    env.reset(options={"scenario": Scenario("x")})
    state, core = env.core.state, env.core
    for k in range(12):
        state.time[0] = elapsed = 0.01 * k
        for y in (0.5, -0.3):  # canonical: left stance
            state.com[0], state.velocity[0] = (0.0, -y), 0.0
            core._look(0, core.n)
            plain = capture_margin(env.robot, env.limits, elapsed, (0.0, y))
            reach = 0.2 * -math.expm1(-env.robot.omega * max(D - elapsed, 0.0)) if y > 0 else 0.0
            assert core.margin[0] == pytest.approx(plain + reach, abs=1e-9)


def test_what_the_hull_can_save_is_not_called_lost():
    """At the start of double support the DCM may lie further towards the other foot by p (1 - exp(-w d))."""
    env = PendulumEnv(preset="double-support")
    for y, lost in ((0.70, False), (0.71, True)):
        env.reset(options={"scenario": Scenario("x")})
        env.core.state.com[0], env.core.state.velocity[0] = (0.0, -y), 0.0
        env.core._look(0, 1)
        assert capture_margin(env.robot, env.limits, 1e3, (0.0, y)) < -0.15  # -0.1 without the hull
        assert bool(env.core.state.failure[0]) == lost


@pytest.mark.parametrize("preset", ["default", "double-support"])
@pytest.mark.parametrize("time", [0.2, 0.4])
def test_the_swing_foots_velocity_is_the_rate_of_its_place(preset, time):
    env = PendulumEnv(preset=preset)
    env.reset(options={"scenario": Scenario("x", command=Command(0.3, 0.1))})
    core, half, places = env.core, 1e-6, []
    for moment in (time - half, time + half, time):
        core.state.time[0] = moment
        core._look(0, 1)
        places.append(core.truth[0, 9:12].copy())
    rate = (places[1] - places[0]) / (2.0 * half)
    assert np.abs(rate).min() > 0.01
    assert core.truth[0, 12:15] == pytest.approx(rate, abs=1e-6)
