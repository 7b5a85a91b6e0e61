"""Pendulums that are not what their planner believes.

The trunk's arrival at its stop, against the parabola of its angle.
"""

import math
import re
from itertools import pairwise

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import transfer_mean
from push_recovery.controllers.model.observation import COM, COM_VELOCITY, DCM, PUSH_ESTIMATE
from push_recovery.controllers.model.robot import GRAVITY, RobotModel
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.pendulum.dynamics import time_to_stop
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.scenario.model_errors import BOUNDS, ModelErrors, PhysicsOptions
from push_recovery.envs.scenario.push import FORCE_MAX, GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.reproduction.pendulum import Measurement, run_batch
from scipy.integrate import solve_ivp

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)
PUSH = Push((60.0, 90.0, 0.0), 0.1, GaitEvent(1, "right", 0.3))
DIFFERENT = (
    ModelErrors(mass=0.2), ModelErrors(delay=0.013), ModelErrors(), ModelErrors(dcm_noise=2e-3),
    ModelErrors(slope_forward=0.02, slope_left=-0.01),
    ModelErrors(mass=-0.1, delay=0.02, slope_left=0.02, dcm_noise=1e-3),
)  # fmt: skip


def episodes(all_scenarios, preset="default", hz=100.0):
    many = PendulumEpisodes(len(all_scenarios), preset=preset, control_hz=hz)
    for k, scenario in enumerate(all_scenarios):
        many.begin(k, scenario)
    return many


def hold(many, cop, trunk, duration=0.65):
    """One period of nominal steps in place under a CoP and a trunk acceleration, canonical."""
    gait = np.array([[0.0, 0.2, duration, *cop, *trunk]]).repeat(many.n, 0)
    many.core.step(gait, np.zeros((many.n, 7)))


def motion(core, k=0):
    s = core.state
    return np.concatenate([s.com[k], s.velocity[k], s.angle[k], s.rate[k]])


def test_a_cycle_equals_numerical_integration():
    """x'' = omega^2 (x - cop - gain a) + F / (1.2 m) - g tan(s), a = asked / 1.2, both late by 13 ms."""
    errors = ModelErrors(mass=0.2, slope_forward=0.03, slope_left=-0.02, delay=0.013)
    push = Push((180.0, -90.0, 0.0), 0.02, 0.05)
    many = episodes([Scenario("x", (push,), errors=errors)], hz=25.0)
    first, second = ((0.04, -0.03), (6.0, -4.0)), ((-0.02, 0.01), (-3.0, 2.0))
    hold(many, *first)
    y, mirror = motion(many.core), np.array([1.0, -1.0])  # left stance

    def rate(t, y):
        cop, trunk = (np.array(x) * mirror for x in (first if t < 0.053 else second))
        asked = trunk / 1.2
        force = np.array(push.force[:2]) * (0.05 <= t < 0.07) / (1.2 * ROBOT.mass)
        downhill = -GRAVITY * np.tan([0.03, -0.02])
        fall = ROBOT.omega**2 * (y[0:2] - cop - ROBOT.trunk_inertia / ROBOT.weight * asked)
        return np.concatenate([y[2:4], fall + force + downhill, y[6:8], asked])

    times = (0.04, 0.05, 0.053, 0.07, 0.08)
    for t0, t1 in pairwise(times):
        inside = 0.5 * (t0 + t1)
        span = solve_ivp(lambda t, y, i=inside: rate(i, y), (t0, t1), y, rtol=1e-12, atol=1e-14)
        y = span.y[:, -1]
    hold(many, *second)
    assert motion(many.core) == pytest.approx(y, abs=1e-10)


@pytest.mark.parametrize("lag", [1, 5])
def test_a_delay_of_whole_periods_shifts_the_actions(lag):
    late = episodes([Scenario("late", errors=ModelErrors(delay=lag * 0.01))])
    prompt = episodes([Scenario("prompt")])
    rng = np.random.default_rng(0)
    asked = [((0.0, 0.0), (0.0, 0.0))] * lag
    asked += [(rng.uniform(-0.05, 0.05, 2), rng.uniform(-9.0, 9.0, 2)) for _ in range(20)]
    for now, then in zip(asked[lag:], asked, strict=False):
        hold(late, *now)
        hold(prompt, *then)
        assert motion(late.core).tobytes() == motion(prompt.core).tobytes()


def test_what_was_asked_for_the_last_step_does_not_move_the_cop_of_this_one():
    """The trunk goes on turning in the world as it was asked to."""
    many = episodes([Scenario("x", errors=ModelErrors(delay=0.02))])
    for _ in range(40):
        hold(many, (0.05, 0.02), (0.0, 1.0), 0.4)
    state = many.core.state
    assert state.steps[0] == 1
    rates = []
    for _ in range(2):
        hold(many, (0.05, 0.02), (0.0, 1.0), 0.4)
        np.testing.assert_array_equal(state.cop[0], state.stance[0])
        rates.append(state.rate[0, 1])
    hold(many, (0.05, 0.02), (0.0, 1.0), 0.4)
    np.testing.assert_allclose(state.cop[0] - state.stance[0], [0.05, 0.02])
    assert np.diff([*rates, state.rate[0, 1]]) == pytest.approx([-0.01, 0.01])  # the swing side has changed


@pytest.mark.parametrize(("delay", "rest"), [(0.02, 0.0), (0.025, 0.005)])
def test_in_double_support_the_transfer_goes_on_until_an_action_of_this_step_arrives(delay, rest):
    many = episodes([Scenario("x", errors=ModelErrors(delay=delay))], "double-support")
    for _ in range(40):
        hold(many, (0.05, 0.02), (0.0, 0.0), 0.4)
    state = many.core.state
    assert state.steps[0] == 1
    for period in range(2):
        hold(many, (0.05, 0.02), (0.0, 0.0), 0.4)
        share = transfer_mean(0.01 * period + rest, 0.01 - rest, many.double_support, ROBOT.omega)
        expected = share * (state.lift[0] - state.stance[0])
        np.testing.assert_allclose(state.cop[0] - state.stance[0], expected, rtol=1e-9)
    hold(many, (0.05, 0.02), (0.0, 0.0), 0.4)
    np.testing.assert_allclose(state.cop[0] - state.stance[0], [0.05, 0.02])


def test_the_push_estimate_holds_the_slope():
    errors = ModelErrors(slope_forward=0.03, slope_left=-0.02)
    many = episodes([Scenario("x", errors=errors)])
    for _ in range(10):
        hold(many, (0.0, 0.0), (0.0, 0.0))
    downhill = -GRAVITY / ROBOT.omega**2 * np.tan([0.03, -0.02]) * [1.0, -1.0]
    assert many.core.observation[0, PUSH_ESTIMATE] == pytest.approx(downhill, abs=1e-12)


def test_noise_is_that_of_an_observer_who_knows_no_other_dcm():
    many = episodes([Scenario("x", noise_seed=7, errors=ModelErrors(dcm_noise=1e-3))])
    policy, core, noise, steps = make_policy("two-stage"), many.core, [], []
    for _ in range(400):
        noise.append(core.observation[0] - core.truth[0])
        steps.append(core.state.steps[0])
        many.step(policy.predict(core.observation)[0])
    noise, side = np.array(noise), np.where(np.array(steps) % 2 == 0, 1.0, -1.0)
    side = np.stack([np.ones_like(side), side], axis=1)
    dcm = side * noise[:, DCM]
    np.testing.assert_allclose(dcm.std(axis=0), 1e-3, rtol=0.12)
    np.testing.assert_allclose(
        noise[:, DCM], noise[:, COM] + noise[:, COM_VELOCITY] / ROBOT.omega, atol=1e-15
    )
    growth = math.exp(ROBOT.omega * 0.01)
    expected = (dcm[1:] - growth * dcm[:-1]) / (growth - 1.0)
    np.testing.assert_allclose(side[1:] * noise[1:, PUSH_ESTIMATE], expected, atol=1e-12)
    assert not noise[0, PUSH_ESTIMATE].any()
    assert not np.delete(noise, [*range(1, 7), 34, 35], axis=1).any()


def endings():
    return [
        Scenario(
            f"s{k}", (PUSH,), Command(0.1 * k), ("left", "right")[k % 2], 1.5, noise_seed=k, errors=errors
        )
        for k, errors in enumerate(DIFFERENT)
    ]


def test_neighbours_and_order_change_nothing():
    policy, scenarios = make_policy("two-stage"), endings()
    together = run_batch(policy, scenarios)
    assert run_batch(policy, scenarios[::-1])[::-1] == together
    assert [run_batch(policy, [scenario])[0] for scenario in scenarios] == together
    assert len({ending.recovered_at for ending in together}) > 1


@pytest.mark.parametrize("errors", DIFFERENT, ids=lambda errors: str(errors.to_dict()))
def test_the_mirrored_scenario_gives_the_mirrored_motion(errors):
    scenario = Scenario("a", (PUSH,), Command(0.2, 0.05), noise_seed=5, errors=errors)
    many, policy = episodes([scenario, scenario.mirrored()]), make_policy("two-stage")
    for _ in range(150):
        many.step(policy.predict(many.core.observation)[0])
        com = many.core.state.com
        assert com[0] == pytest.approx(com[1] * [1.0, -1.0], abs=1e-9)
    clean = episodes([Scenario("a", (PUSH,), Command(0.2, 0.05))])
    for _ in range(150):
        clean.step(policy.predict(clean.core.observation)[0])
    assert np.array_equal(clean.core.state.com[0], many.core.state.com[0]) == (errors == ModelErrors())


@pytest.mark.parametrize("name", ["payload", "friction", "joint_noise", "floor_step"])
def test_errors_that_a_pendulum_cannot_have_are_refused(name):
    many = episodes([Scenario("x")])
    text = (
        f"the pendulum has no model error '{name}' "
        "(valid: mass, slope_forward, slope_left, delay, dcm_noise), got 0.05"
    )
    value = 0.5 if name == "friction" else 0.05
    with pytest.raises(InvalidValueError, match=re.escape(text.replace("0.05", str(value)))):
        many.begin(0, Scenario("y", errors=ModelErrors(**{name: value})))


def test_two_kinds_of_noise_at_once_are_refused():
    scenario = Scenario("noisy", errors=ModelErrors(dcm_noise=1e-3))
    with pytest.raises(InvalidValueError, match="'noisy' has dcm_noise of its own"):
        run_batch(make_policy("two-stage"), [scenario], measurement=Measurement(dcm_noise=1e-3))


def test_a_pendulum_takes_no_options_of_physics():
    many = episodes([Scenario("a")])
    with pytest.raises(InvalidValueError, match=r"integrated exactly.*'time_step': 0.001"):
        many.begin(0, Scenario("b", physics=PhysicsOptions(time_step=0.001)))


def test_a_pendulum_has_no_sensors():
    many = episodes([Scenario("a")])
    with pytest.raises(InvalidValueError, match=r"no sensors: sensing must be 'exact', got 'onboard'"):
        many.begin(0, Scenario("b", sensing="onboard"))


@pytest.mark.parametrize("noise", [0.0, BOUNDS["dcm_noise"][2]])
def test_the_hardest_pushes_end_only_the_pendulums_that_they_hit(noise):
    calm = Scenario("calm", (Push((20.0, 10.0, 0.0), 0.1, 0.06),), duration=1.5)
    hits = [
        Push((force * x, force * y, 0.0), duration, 0.05)
        for force in (1e4, 1e6, FORCE_MAX) for duration in (1e-4, 0.1) for x, y in ((1.0, 0.0), (-0.6, -0.8))
    ]  # fmt: skip

    def walk(pushes):
        off = ModelErrors(dcm_noise=noise)
        many = episodes([calm, *(Scenario("hit", (push,), duration=1.5, errors=off) for push in pushes)])
        policy = make_policy("two-stage", many.robot, many.limits, many.preset)
        seen = []
        for _ in range(100):
            actions = policy.predict(many.core.observation)[0]
            period = many.step(actions)
            assert np.isfinite(actions).all()
            assert np.isfinite(many.core.observation).all()
            assert np.isfinite(period.reward.total).all()
            seen.append(many.core.observation[0].copy())
        return np.array(seen), many.failure()

    (seen, failure), (alone, _) = walk(hits), walk([PUSH] * len(hits))
    np.testing.assert_array_equal(seen, alone)
    assert failure[0] == 0
    assert failure[1:][[push.impulse_magnitude >= 1e3 for push in hits]].all()


def test_time_to_stop_is_the_first_root():
    rng = np.random.default_rng(0)
    for _ in range(200):
        angle, rate, a = rng.uniform(-1, 1), rng.normal(0, 3), rng.normal(0, 15)
        s = time_to_stop(angle, rate, a, 1.0472)
        times = np.linspace(0, min(s, 3.0), 2000)[:-1]
        assert np.abs(angle + rate * times + a * times**2 / 2).max() <= 1.0472 + 1e-9
        if math.isfinite(s):
            assert abs(angle + rate * s + a * s * s / 2) == pytest.approx(1.0472, abs=1e-9)


def test_a_stander_rests_between_its_feet_until_its_first_action_arrives():
    errors = ModelErrors(delay=0.02)
    many = episodes([Scenario("x", (), Command(stand=True), errors=errors)])
    for expected in ([0.0, -0.1], [0.0, -0.1], [0.05, -0.02]):
        hold(many, (0.05, 0.02), (0.0, 0.0), LIMITS.duration_max)
        np.testing.assert_allclose(many.core.state.cop[0], expected, atol=1e-12)
