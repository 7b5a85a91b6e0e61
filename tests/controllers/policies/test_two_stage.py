"""The two-stage planner as a policy, its variants and the baselines of the field: what each may use."""

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model import observation as columns
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, nominal_start
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies import two_stage
from push_recovery.controllers.policies.two_stage import POLICY_NAMES, TwoStagePolicy, make_policy
from push_recovery.controllers.settings import (
    VARIANTS,
    PlannerConfig,
    PresetFile,
    named_preset,
    preset_config,
)
from push_recovery.controllers.stage_1 import LATEST, StepProblem, solve_step, swing_time

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)


def random_observations(n, seed=0):
    rng = np.random.default_rng(seed)
    obs = rng.normal(0.0, 0.05, (n, 36))
    obs[:, columns.ELAPSED] = rng.uniform(0.0, 0.6, n)
    obs[:, columns.TRUNK_RATE] *= 10
    obs[:, columns.COMMAND] = rng.uniform([-0.25, -0.2], [0.5, 0.2], (n, 2))
    obs[:, columns.PREVIOUS_ACTION] = rng.uniform(-1, 1, (n, 7))
    return obs


@pytest.mark.parametrize("name", POLICY_NAMES)
@pytest.mark.parametrize("preset", ["default", "biped"])
def test_is_a_function_of_the_observation_alone(name, preset):
    policy = make_policy(name, preset=preset)
    obs = random_observations(12)
    batch, state = policy.predict(obs, state="anything")
    assert batch.shape == (12, 7)
    assert batch.dtype == np.float32
    assert np.abs(batch).max() <= 1.0
    assert state == "anything"
    for i in reversed(range(12)):  # other order, one at a time, fresh or used: the same bits
        assert np.array_equal(policy.predict(obs[i])[0], batch[i])
    assert np.array_equal(make_policy(name, preset=preset).predict(obs[3])[0], batch[3])


@pytest.mark.parametrize("name", [n for n in POLICY_NAMES if n != "random"])
def test_action_is_the_plan_in_the_units_of_the_limits(name):
    policy = make_policy(name)
    for obs in random_observations(5, 1):
        assert np.array_equal(policy.predict(obs)[0], LIMITS.to_action(policy.plan(obs).gait))


@pytest.mark.parametrize("name", [n for n in POLICY_NAMES if n not in ("random", "passive")])
def test_nominal_state_gives_the_nominal_step(name):
    for command in ((0.0, 0.0), (0.5, 0.0)):
        gait = nominal_gait(ROBOT, LIMITS, command)
        obs = np.zeros(36)
        obs[columns.COMMAND] = command
        obs[columns.DCM] = gait.offset_x, -gait.offset_y
        obs[columns.COM] = nominal_start(gait, ROBOT.pelvis_width, ROBOT.omega).com
        plan = make_policy(name).plan(obs)
        assert plan.gait[:3] == pytest.approx([gait.length, gait.width, gait.duration], abs=1e-6)
        if "paper" not in name:
            assert plan.gait[3:] == pytest.approx(np.zeros(4), abs=1e-6)


def discounted(shift, duration, omega):
    """int_0^duration omega exp(-omega s) shift ds by quadrature, shift constant."""
    edges = np.linspace(0.0, duration, 2001)
    middle = 0.5 * (edges[1:] + edges[:-1])
    return shift * np.sum(omega * np.exp(-omega * middle)) * (edges[1] - edges[0])


def test_stage_1_solves_equation_3():
    policy, thresholds = make_policy("stage-1"), set()
    for obs in random_observations(50, 2):
        t, omega = obs[columns.ELAPSED], ROBOT.omega
        obs[columns.PUSH_ESTIMATE] *= 4.0
        carried = (
            0.1 if np.linalg.norm(obs[columns.PUSH_ESTIMATE]) >= 0.2 else 0.0
        )  # the push goes on for 0.1 s
        thresholds.add(carried)
        plan, dcm = (
            policy.plan(obs),
            obs[columns.DCM] + discounted(obs[columns.PUSH_ESTIMATE], carried, omega),
        )
        for axis, rate in enumerate(obs[columns.TRUNK_RATE]):  # the trunk is stopped by its full torque
            torque = math.copysign(ROBOT.trunk_torque_max, rate)
            dcm[axis] += discounted(torque / ROBOT.weight, 8.0 * abs(rate) / 150.0, omega)
        gain = dcm * math.exp(-omega * t)
        exact = solve_step(
            StepProblem(
                gain=(gain[0], gain[1]),
                step_nominal=(plan.nominal.length, plan.nominal.width),
                tau_nominal=math.exp(omega * plan.nominal.duration),
                offset_nominal=(plan.nominal.offset_x, plan.nominal.offset_y),
                step_low=(-0.5, LIMITS.width_min),
                step_high=(0.5, LIMITS.width_max),
                tau_low=math.exp(omega * max(0.3, t)),
                tau_high=math.exp(omega * 1.0),
            )
        )
        assert plan.step == pytest.approx(exact.step, abs=1e-6)
        assert plan.duration == pytest.approx(exact.duration(omega), abs=1e-6)
        assert plan.offset == pytest.approx(exact.offset, abs=1e-6)
        assert plan.dcm_target == pytest.approx(plan.step + plan.nominal.offset)  # eq. 7
    assert thresholds == {0.0, 0.1}


def test_variants_use_only_what_they_may():
    obs = random_observations(1, 3)[0]
    obs[columns.DCM] = 0.15, 0.2
    obs[columns.ELAPSED] = 0.1
    plans = {name: make_policy(name).plan(obs) for name in POLICY_NAMES if name != "random"}
    upright = np.clip(-20 * obs[columns.TRUNK_ANGLE] - 9 * obs[columns.TRUNK_RATE], -18.75, 18.75)
    for name in ("passive", "raibert", "herdt", "fixed-time", "stage-1", "stage-1-paper", "stage-1+cop"):
        assert plans[name].trunk_acceleration == pytest.approx(upright)
    for name in ("passive", "raibert", "fixed-time", "stage-1", "stage-1-paper", "stage-1+momentum"):
        assert plans[name].cop.tolist() == [0.0, 0.0]
    for name in ("herdt", "stage-1+cop"):
        assert np.abs(plans[name].cop).max() > 0.01
    assert np.abs(plans["two-stage"].cop).max() > 0.01
    assert np.abs(plans["stage-1+momentum"].trunk_acceleration - upright).max() > 1.0
    assert plans["passive"].step == pytest.approx(
        [plans["passive"].nominal.length, plans["passive"].nominal.width]
    )
    assert plans["stage-1-paper"].duration != plans["stage-1"].duration


def test_duration_is_never_in_the_past_and_never_after_its_maximum_unless_late():
    policy = make_policy("two-stage")
    for t in (0.0, 0.5, 0.99, 1.0, 1.2):
        obs = random_observations(1, 4)[0]
        obs[columns.ELAPSED] = t
        plan = policy.plan(obs)
        assert plan.duration >= t - 1e-9
        assert plan.duration <= max(1.0, t) + 1e-9


def test_plan_is_held_at_the_end_of_a_step():
    policy = TwoStagePolicy(config=PlannerConfig(freeze=0.034, touchdown_delay=0.026))
    obs = random_observations(1, 5)[0]
    previous = np.array([0.1, 0.25, 0.5, 0, 0, 0, 0])
    obs[columns.PREVIOUS_ACTION] = LIMITS.to_action(previous)
    obs[columns.ELAPSED] = 0.48
    plan = policy.plan(obs)
    assert plan.held
    assert plan.gait[:3] == pytest.approx(previous[:3], abs=1e-6)
    obs[columns.ELAPSED] = 0.0  # a new step: nothing to hold
    assert not policy.plan(obs).held
    assert policy.plan(obs).remaining == pytest.approx(policy.plan(obs).duration + 0.026)


def test_touchdown_delay_is_in_the_prediction():
    delay = 0.026
    policy = TwoStagePolicy(config=PlannerConfig(touchdown_delay=delay, use_cop=False, use_trunk=False))
    obs = random_observations(1, 6)[0]
    plan = policy.plan(obs)
    end = obs[columns.DCM] * math.exp(ROBOT.omega * (plan.duration + delay - obs[columns.ELAPSED]))
    assert plan.step + plan.offset == pytest.approx(end)


@pytest.mark.parametrize("name", ["two-stage", "stage-1", "random"])
@pytest.mark.parametrize(
    "bad",
    [np.zeros(shape) for shape in (33, (2, 33), (1, 2, 36))]
    + [np.full(36, np.nan), np.full(36, np.inf), "x", 1.0],
)
def test_bad_observations(name, bad):
    with pytest.raises(InvalidValueError, match="observation"):
        make_policy(name).predict(bad)


NO_TIME = "elapsed time must lie within"


@pytest.mark.parametrize("name", ["stage-1", "stage-1+cop", "two-stage"])
@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        (columns.ELAPSED, -1e300, r"within \+-1e\+15 in every entry, got 1e\+300"),
        (columns.ELAPSED, -1e14, NO_TIME),
        (columns.ELAPSED, -150.0, NO_TIME),
        (columns.ELAPSED, 150.0, NO_TIME),
        (columns.ELAPSED, 1e14, NO_TIME),
        (columns.ELAPSED, 1e300, "in every entry"),
        (columns.DCM.start, 1e300, "in every entry"),
        (columns.DCM.start + 1, -1e16, "in every entry"),
        (columns.PUSH_ESTIMATE.start, -1e300, "in every entry"),
    ],
)
def test_numbers_that_no_robot_can_show_are_refused(name, column, value, message):
    obs = random_observations(3, 9)
    obs[1, column] = value
    with pytest.raises(InvalidValueError, match=message):
        make_policy(name).predict(obs)


@pytest.mark.parametrize("preset", ["default", "biped"])
@pytest.mark.parametrize("name", ["stage-1", "stage-1+momentum", "two-stage"])
def test_a_robot_thrown_far_away_still_gets_an_action(name, preset):
    policy, limits = make_policy(name, preset=preset), 0.9 * LATEST / ROBOT.omega
    for far in (1e3, 1e9, 1e15):
        obs = np.concatenate([far * np.eye(36)[1:], -far * np.eye(36)[1:], np.full((2, 36), far)])
        obs[-2:, columns.ELAPSED] = 0.1, limits
        action = policy.predict(obs)[0]
        assert np.abs(action).max() <= 1.0  # NaN is not


@pytest.mark.parametrize("wrong", ["robot", "limits", "config"])
def test_parts_of_another_class_are_refused(wrong):
    with pytest.raises(InvalidValueError, match=rf"^{wrong} must be a \w+, got 3$"):
        TwoStagePolicy(**{wrong: 3})


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_no_action(threads):
    obs = random_observations(1100, 7)
    shared = TwoStagePolicy(threads=threads)
    assert shared.predict(obs)[0].tobytes() == TwoStagePolicy().predict(obs)[0].tobytes()
    assert len(shared.statuses) == 1100
    assert set(shared.statuses) <= {"solved", "clipped"}
    obs[1050, 3] = np.nan
    with pytest.raises(InvalidValueError, match="finite"):
        shared.predict(obs)


def test_an_observation_that_may_not_be_written_to_is_as_good_as_any():
    policy, obs = make_policy("two-stage"), random_observations(4, 8)
    frozen, turned = obs.copy(), np.asfortranarray(obs)
    frozen.flags.writeable = False
    for other in (frozen, turned):
        assert policy.predict(other)[0].tobytes() == policy.predict(obs)[0].tobytes()


def test_unknown_names():
    with pytest.raises(UnknownNameError, match="two-stage"):
        make_policy("two-stages")
    with pytest.raises(UnknownNameError, match="biped"):
        make_policy("two-stage", preset="bipedal")


def test_swing_time_is_that_of_the_quintic_from_rest_and_half_of_it_half_way():
    """Rest to rest in t: peak acceleration 10 d / (sqrt(3) t^2), half-way at speed 15 d / (8 t)."""
    distance, bound = 0.6, 100.0
    whole = math.sqrt(10.0 * distance / (math.sqrt(3.0) * bound))
    assert swing_time(distance, 0.0, bound) == pytest.approx(whole, rel=1e-12)
    half = swing_time(distance / 2, 15.0 * distance / (8.0 * whole), bound)
    assert half == pytest.approx(whole / 2, rel=2e-3)


def test_the_step_lasts_as_long_as_the_swing_foot_needs():
    """A far place waits for the foot, as far as T_max lets it; a near one is planned as before."""
    bound, waited = 30.0, 0
    free, slow = (
        TwoStagePolicy(ROBOT, LIMITS, replace(preset_config("default"), swing_acceleration=a))
        for a in (0.0, bound)
    )
    for obs in random_observations(200, 6):
        obs[columns.ELAPSED] *= 0.5
        before, plan = free.plan(obs), slow.plan(obs)
        way = plan.step - obs[columns.SWING_POSITION][:2]
        distance = np.hypot(*way)
        needed = obs[columns.ELAPSED] + swing_time(
            distance, way @ obs[columns.SWING_VELOCITY][:2] / distance, bound
        )
        assert plan.duration >= min(needed, LIMITS.duration_max) - 0.01
        assert plan.duration >= before.duration
        waited += plan.duration > before.duration
    assert 20 < waited < 180


def test_a_push_reopens_a_step_that_is_about_to_land():
    """A push to the swing side shortly before landing: the foot goes farther out and lands later."""
    config = PlannerConfig(freeze=0.03, push_carry=0.02, push_threshold=0.1, swing_acceleration=160.0)
    policy, obs = TwoStagePolicy(config=config), np.zeros(36)
    obs[columns.PREVIOUS_ACTION] = LIMITS.to_action(np.array([0.0, 0.2, 0.4, 0.0, 0.0, 0.0, 0.0]))
    obs[columns.ELAPSED], obs[columns.DCM], obs[columns.SWING_POSITION] = 0.38, (0.0, 0.3), (0.0, 0.2, 0.01)
    assert policy.plan(obs).held
    obs[columns.PUSH_ESTIMATE] = 0.0, 0.15
    plan = policy.plan(obs)
    assert not plan.held
    assert plan.step[1] > 0.3
    assert plan.duration >= 0.38 + config.freeze


@pytest.mark.parametrize("name", ["stage-1+cop", "stage-1+momentum", "two-stage"])
def test_the_whole_plan_is_held_shortly_before_landing(name):
    """From T - freeze on a variant repeats its action, except where only the upright law moves the trunk."""
    policy = make_policy(name, ROBOT, LIMITS, "biped")
    rng = np.random.default_rng(4)
    observations = rng.normal(0.0, 0.1, (50, 36))
    previous = rng.uniform(-0.9, 0.9, (50, 7))
    previous[:, 3:5] *= policy.config.use_cop
    previous[:, 5:7] *= policy.config.use_trunk
    observations[:, columns.PREVIOUS_ACTION], observations[:, columns.PUSH_ESTIMATE] = previous, 0.0
    durations = LIMITS.from_action(previous)[:, 2]
    kept = 7 if policy.config.use_trunk else 5
    for before, holds in ((0.9, True), (1.1, False)):
        observations[:, columns.ELAPSED] = durations - before * policy.config.freeze
        actions = policy.predict(observations)[0]
        same = np.isclose(actions[:, :kept], previous[:, :kept], atol=1e-6).all(axis=1)
        assert same.all() == holds
        one_by_one = np.array([policy.plan(obs).gait for obs in observations])
        np.testing.assert_allclose(LIMITS.to_action(one_by_one), actions, atol=1e-6)


def files_of_a_decision(policy, obs):
    """Files of this project with a frame in one `predict`, in the order in which they are entered.

    A compiled function that Python calls has a frame, those that it calls have none.
    """
    controllers, found = Path(two_stage.__file__).parents[1], []

    def look(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(controllers):
            found.append(str(path.relative_to(controllers)))

    sys.setprofile(look)
    try:
        policy.predict(obs)
    finally:
        sys.setprofile(None)
    return list(dict.fromkeys(found))


DEFAULT_FORM = ["policies/two_stage.py", "model/observation.py", "stage_1.py", "stage_2/single_support.py"]
DOUBLE_SUPPORT = [*DEFAULT_FORM[:3], "stage_2/double_support.py"]


@pytest.mark.parametrize("rows", [1, 5])
@pytest.mark.parametrize(("change", "elapsed", "files"), [
    ({}, 0.1, DEFAULT_FORM),
    ({"use_cop": False}, 0.1, DEFAULT_FORM),
    ({"use_cop": False, "use_trunk": False}, 0.1, [*DEFAULT_FORM[:3], "stage_2/problem.py"]),
    ({"double_support": 0.1, "touchdown_delay": 0.0}, 0.02, [*DOUBLE_SUPPORT, "stage_2/problem.py"]),
    ({"double_support": 0.1, "touchdown_delay": 0.0}, 0.3, [*DOUBLE_SUPPORT, DEFAULT_FORM[3]]),
])  # fmt: skip
def test_an_observation_becomes_an_action_in_four_files(change, elapsed, files, rows):
    """A planner of double support has a fifth, for each of its two phases another one."""
    policy = TwoStagePolicy(ROBOT, LIMITS, preset_config("default").replace(**change))
    obs = random_observations(rows)
    obs[:, columns.ELAPSED] = elapsed
    policy.predict(obs)  # compiles
    assert files_of_a_decision(policy, obs[0] if rows == 1 else obs) == files


def test_the_planner_is_twenty_files():
    """All that importing it loads of this project, packages included."""
    code = (
        "import sys\n"
        "import push_recovery.controllers.policies.two_stage\n"
        "print(*sorted(name for name in sys.modules if name.split('.')[0] == 'push_recovery'))"
    )
    out = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    modules = out.stdout.split()
    assert "push_recovery.controllers.stage_2.single_support" in modules
    assert len(modules) <= 20, modules


PUSHED = np.zeros(36)
PUSHED[columns.ELAPSED], PUSHED[columns.DCM], PUSHED[columns.COMMAND] = 0.1, (0.15, 0.2), (0.2, 0.0)


def variant(name: str, preset: str = "default") -> TwoStagePolicy:
    policy = make_policy(name, preset=preset)
    assert isinstance(policy, TwoStagePolicy)
    return policy


@pytest.mark.parametrize("name", ["raibert", "herdt", "fixed-time"])
def test_the_time_of_a_baseline_is_nominal_whatever_happens(name):
    policy = variant(name)
    nominal = nominal_gait(policy.robot, policy.limits, (0.2, 0.0))
    plan = policy.plan(PUSHED)
    assert plan.duration == pytest.approx(nominal.duration, abs=1e-12)
    assert plan.step[0] > nominal.length + 0.05  # and its place is not
    assert variant("stage-1").plan(PUSHED).duration < nominal.duration - 0.05


def test_with_a_fixed_time_the_place_is_a_weighted_mean():
    """min alpha_1 (u - u_nom)^2 + alpha_3 (a tau - u - b_nom)^2 for T nominal, a = xi exp(-omega t)."""
    policy = variant("fixed-time", "biped")
    config, omega = policy.config, policy.robot.omega
    delay = config.touchdown_delay
    nominal = nominal_gait(policy.robot, policy.limits, (0.2, 0.0), delay)
    observation = PUSHED.copy()
    observation[columns.DCM] = 0.05, 0.1
    end = 0.05 * math.exp(omega * (nominal.duration + delay - 0.1))
    weights = config.alpha_step, config.alpha_offset
    length = (weights[0] * nominal.length + weights[1] * (end - nominal.offset_x)) / sum(weights)
    assert policy.limits.low[0] < length < policy.limits.high[0]
    assert policy.plan(observation).step[0] == pytest.approx(length, abs=1e-12)


def test_a_preset_may_tune_a_baseline():
    preset = PresetFile("biped", variants={"raibert": {"upright_stiffness": 12.0}})
    assert preset.config("raibert").upright_stiffness == 12.0
    base = named_preset("biped")
    assert preset.config("raibert").upright_damping == base.config("raibert").upright_damping
    assert preset.config("fixed-time") == base.config("fixed-time")


def test_a_variant_overrides_of_a_preset_only_what_makes_it_that_variant():
    assert VARIANTS["two-stage"].settings == {"use_cop": True, "use_trunk": True}
    fixed = {"use_cop": False, "use_trunk": False, "adapt_duration": False}
    assert VARIANTS["fixed-time"].settings == fixed
    rule = {"use_cop": False, "use_trunk": False, "foothold": "capture_point"}
    assert VARIANTS["raibert"].settings == rule
    assert VARIANTS["herdt"].settings == {**rule, "foothold": "linear_mpc"}


@pytest.mark.parametrize("name", ["raibert", "fixed-time", "stage-1"])
def test_without_stage_2_the_dcm_is_expected_where_it_drifts_to(name):
    """About the sole's centre: xi(T) = xi(t) exp(omega (T - t))."""
    plan = variant(name).plan(PUSHED)
    end = PUSHED[columns.DCM] * math.exp(ROBOT.omega * plan.remaining)
    np.testing.assert_allclose(plan.dcm_end, end, atol=1e-6)
