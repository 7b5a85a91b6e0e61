"""The native vector environment against Gymnasium's own loop over single environments, bit for bit.

Model errors through gym.make and gym.make_vec: each robot's own, through partial resets, from ranges.
"""

import inspect
import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEnv, make_biped_vector
from push_recovery.envs.episode.period_end import REWARD_TERMS
from push_recovery.envs.pendulum.env import PendulumEnv, PendulumEpisodes, make_pendulum_vector
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.envs.wrappers import ResidualVectorEnv, make_biped_residual, make_biped_residual_vector

PENDULUM, BIPED, RESIDUAL = (f"PushRecovery/{name}-v0" for name in ("Pendulum", "Biped", "BipedResidual"))
HARD = {"impulse_min": 10.0, "impulse_max": 250.0, "first_step": 0, "settle_time": 0.9}
MODES = (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)


def native(name, n, **kwargs):
    return gym.make_vec(f"push_recovery:{name}", n, vectorization_mode="vector_entry_point", **kwargs)


def row(info, k):
    """The info of robot k without what is None or NaN, which are the same in vector form."""
    out = {}
    for key, values in info.items():
        if key.startswith("_") or not info[f"_{key}"][k]:
            continue
        value = row(values, k) if isinstance(values, dict) else values[k]
        if key == "final_info" or isinstance(value, dict):
            out[key] = value
        elif value is not None and not (isinstance(value, float) and math.isnan(value)):
            out[key] = np.asarray(value).tolist()
    return out


def assert_same(ours, theirs):
    for a, b in zip(ours[:-1], theirs[:-1], strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()
        assert np.asarray(a).dtype == np.asarray(b).dtype
    for k in range(len(ours[0])):
        assert row(ours[-1], k) == row(theirs[-1], k)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("name", "n", "steps", "kwargs"),
    [
        (PENDULUM, 1, 200, {}),
        (PENDULUM, 5, 250, {}),
        (PENDULUM, 3, 150, {"preset": "double-support", "control_hz": 50.0}),
        (BIPED, 1, 150, {}),
        (BIPED, 5, 220, {}),
        (RESIDUAL, 3, 150, {}),
        (RESIDUAL, 3, 60, {"hold": 3, "gate": [0.01, 0.05], "scale": 0.4}),
    ],
)
def test_robots_are_those_of_single_environments(name, n, steps, kwargs, mode):
    kwargs = {**kwargs, "push_distribution": HARD}
    ours = native(name, n, autoreset_mode=mode.value, **kwargs)
    theirs = gym.make_vec(
        name, n, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **kwargs
    )
    assert ours.metadata["autoreset_mode"] is mode
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    policy = make_policy("two-stage", ours.robot, ours.limits, ours.preset)
    rng, ends = np.random.default_rng(1), [0, 0]
    observations, info = ours.reset(seed=11)
    assert_same((observations, info), theirs.reset(seed=11))
    for _ in range(steps):
        actions = rng.normal(0.0, 0.3, (n, 7))
        if name != RESIDUAL:
            actions = 0.5 * actions + policy.predict(observations)[0]
        step = ours.step(actions.astype(np.float32))
        assert_same(step, theirs.step(actions.astype(np.float32)))
        observations = step[0]
        ends[0] += int(step[2].sum())
        ends[1] += int(step[3].sum())
    assert sum(ends) > 0
    if n == 5:
        assert min(ends) > 0  # falls and time limits
    theirs.close()
    ours.close()


def scenarios():
    pushes = [
        (),
        (polar_push(250.0, 0.7, 0.1, GaitEvent(1, "left", 0.3)),),
        (polar_push(300.0, 2.0, 0.1, 0.2), polar_push(120.0, -1.0, 0.05, 0.5)),
        (polar_push(1200.0, 1.6, 0.2, 0.1),),
        (polar_push(200.0, -2.5, 0.1, GaitEvent(9, "left")),),
    ]
    commands = Command(), Command(0.4), Command(-0.2), Command(0.0, 0.15), Command(0.0, -0.15)
    return [
        Scenario(f"s{i}", push, command, ("left", "right")[i % 2], duration=1.5)
        for i, (push, command) in enumerate(zip(pushes, commands, strict=True))
    ]


def plain(push):
    """A push of `info` as `row` gives it."""
    return {key: np.asarray(v).tolist() for key, v in push.items() if v is not None} if push else None


def alone(name, scenario, actions):
    """Observations, rewards and pushes of a single environment, to the end of its episode."""
    env = gym.make(name)
    observation, info = env.reset(options={"scenario": scenario})
    trace = [(observation, 0.0, plain(info["push"]))]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        trace.append((observation, reward, plain(info["push"])))
        if terminated or truncated:
            break
    env.close()
    return trace


@pytest.mark.parametrize("name", [PENDULUM, BIPED])
def test_scenarios_in_any_place_and_number(name):
    """Robot k of n runs its own scenario and actions as it would alone, wherever it stands among others."""
    acts = 0.2 * np.random.default_rng(3).normal(size=(5, 60, 7)).astype(np.float32)
    expected = [alone(name, scenario, acts[i]) for i, scenario in enumerate(scenarios())]
    assert len(expected[3]) < 60  # that push fells it
    for order, kwargs in (((0, 1, 2, 3, 4), {}), ((3, 4, 1), {"threads": 2}), ((2,), {})):
        env = native(name, len(order), **(kwargs if name == BIPED else {}))
        observations, info = env.reset(options={"scenario": [scenarios()[i] for i in order]})
        assert info["scenario_id"].tolist() == [f"s{i}" for i in order]
        rewards, ended = np.zeros(len(order)), np.zeros(len(order), bool)
        for t in range(61):
            for k, i in enumerate(order):
                if t < len(expected[i]):
                    observation, reward, push = expected[i][t]
                    assert observations[k].tobytes() == observation.tobytes()
                    assert rewards[k] == reward
                    assert row(info, k).get("push") == push
                    assert ended[k] == (0 < t == len(expected[i]) - 1 < 60)
            if t < 60:
                observations, rewards, terminated, truncated, info = env.step(acts[list(order), t])
                ended = terminated | truncated
        env.close()


@pytest.mark.parametrize("name", [PENDULUM, BIPED])
def test_a_partial_reset_leaves_the_others_alone(name):
    given = scenarios()
    acts = 0.1 * np.random.default_rng(4).normal(size=(40, 3, 7)).astype(np.float32)
    env = native(name, 3, autoreset_mode="Disabled")
    before, _ = env.reset(options={"scenario": [given[0], given[1], given[4]]})
    for t in range(20):
        before = env.step(acts[t])[0]
    mask = np.array([False, True, False])
    now, info = env.reset(options={"scenario": given[2], "reset_mask": mask})
    assert now[~mask].tobytes() == before[~mask].tobytes()
    assert info["_scenario_id"].tolist() == mask.tolist()
    assert info["scenario_id"].tolist() == ["s0", "s2", "s4"]
    traces = [now, *(env.step(acts[t])[0] for t in range(20, 40))]
    fresh = alone(name, given[2], acts[20:40, 1])
    rest = [alone(name, given[i], acts[:, k])[20:] for k, i in ((0, 0), (2, 4))]
    for t in range(21):
        assert traces[t][1].tobytes() == fresh[t][0].tobytes()
        assert traces[t][0].tobytes() == rest[0][t][0].tobytes()
        assert traces[t][2].tobytes() == rest[1][t][0].tobytes()


def test_seeds_draw_what_single_environments_draw():
    env, single = native(PENDULUM, 3), gym.make(PENDULUM)
    drawn = []
    for seed in (7, 8, 9):
        drawn.append([single.reset(seed=seed)[1]["scenario_id"], single.reset()[1]["scenario_id"]])
    assert env.reset(seed=7)[1]["scenario_id"].tolist() == [ids[0] for ids in drawn]
    assert env.np_random_seed == (7, 8, 9)
    assert env.reset()[1]["scenario_id"].tolist() == [ids[1] for ids in drawn]
    assert env.reset(seed=[9, 7, 8])[1]["scenario_id"].tolist() == [drawn[i][0] for i in (2, 0, 1)]
    mask = np.array([False, False, True])
    env.reset(seed=[None, None, 8], options={"reset_mask": mask})
    after = env.reset()[1]["scenario_id"].tolist()
    assert after == [drawn[i][1] for i in (2, 0, 1)]  # the first two went on, the third began anew


def test_info_is_the_callers_and_its_masks_say_what_is_there():
    env = native(PENDULUM, 2)
    quiet = Scenario("quiet", duration=0.05)
    _, first = env.reset(options={"scenario": [quiet, scenarios()[4]]})
    assert first["_push"].tolist() == [False, True]
    assert first["push"]["_start"].tolist() == [False, False]  # its gait event has not come
    assert not any(first["_failure_reason"])
    kept = {key: value.copy() for key, value in first.items() if isinstance(value, np.ndarray)}
    for _ in range(10):
        _, reward, _, _, info = env.step(np.zeros((2, 7), np.float32))
        terms = [info["reward_terms"][name] for name in REWARD_TERMS]
        assert reward == pytest.approx(sum(terms))
    for key, value in kept.items():
        assert np.array_equal(first[key], value, equal_nan=value.dtype == float), key


class Remembering:
    """A policy whose action depends on what it saw before."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), 7), np.float32), np.ones(len(observation))


def test_a_residual_on_n_robots_needs_a_policy_without_memory():
    env = ResidualVectorEnv(PendulumEpisodes(2), Remembering())
    env.reset(seed=0)
    with pytest.raises(InvalidValueError, match="without memory"):
        env.step(np.zeros((2, 7)))


def test_a_residual_of_zero_is_the_policy_on_any_robot():
    plain, residual = native(PENDULUM, 3), ResidualVectorEnv(PendulumEpisodes(3), "stage-1")
    policy = make_policy("stage-1", plain.robot, plain.limits, plain.preset)
    observations, (_, first) = plain.reset(seed=2)[0], residual.reset(seed=2)
    assert not first["_baseline_action"].any()
    for _ in range(60):
        base = policy.predict(observations)[0]
        observations = plain.step(base)[0]
        again, *_, info = residual.step(np.zeros((3, 7)))
        assert again.tobytes() == observations.tobytes()
        assert info["baseline_action"].tobytes() == base.tobytes()
        assert not info["residual_action"].any()
        assert not info["_qp_status"].any()  # stage 1 alone has no such solver


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("name", "kwargs"), [(PENDULUM, {}), (RESIDUAL, {"hold": 2}), ("PushRecovery/BipedJoint-v0", {})]
)
def test_a_limit_of_steps_truncates_as_in_the_single_form(name, kwargs, mode):
    kwargs = {**kwargs, "max_episode_steps": 7}
    ours = native(name, 2, autoreset_mode=mode.value, **kwargs)
    theirs = gym.make_vec(
        name, 2, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **kwargs
    )
    assert_same(ours.reset(seed=1), theirs.reset(seed=1))
    ends = []
    for _ in range(18):
        actions = np.zeros(ours.action_space.shape, np.float32)
        step = ours.step(actions)
        assert_same(step, theirs.step(actions))
        ends.append(step[3].tolist())
    assert [i for i, end in enumerate(ends, 1) if end == [True, True]] == (
        [7, 15] if mode is AutoresetMode.NEXT_STEP else [7, 14]
    )
    theirs.close()


def test_without_a_limit_of_steps_the_scenario_ends_the_episode():
    for limit in (None, -1, np.int64(100)):
        env = native(PENDULUM, 1, max_episode_steps=limit)
        env.reset(options={"scenario": Scenario("short", duration=0.1)})
        ends = [env.step(np.zeros((1, 7)))[3].item() for _ in range(10)]
        assert ends == 9 * [False] + [True]
    with pytest.raises(InvalidValueError, match="max_episode_steps must be an integer >= 1, got 0"):
        native(PENDULUM, 1, max_episode_steps=0)


def test_gymnasiums_vector_wrappers_work():
    env = RecordEpisodeStatistics(native(PENDULUM, 2))
    env.reset(options={"scenario": Scenario("short", duration=0.1)})
    rewards = [env.step(np.zeros((2, 7), np.float32)) for _ in range(10)]
    info = rewards[-1][4]
    assert info["episode"]["l"].tolist() == [10, 10]
    assert info["episode"]["r"] == pytest.approx(sum(step[1] for step in rewards), rel=1e-5)


def test_the_native_form_is_the_default_and_can_be_made_again():
    env = gym.make_vec(PENDULUM, num_envs=2, control_hz=50.0)
    assert type(env.unwrapped).__name__ == "GaitVectorEnv"
    again = gym.make_vec(env.spec)
    assert (again.num_envs, again.dt) == (2, 0.02)


@pytest.mark.parametrize(
    ("one", "many"),
    [
        (PendulumEnv, make_pendulum_vector),
        (BipedEnv, make_biped_vector),
        (make_biped_residual, make_biped_residual_vector),
    ],
)
def test_arguments_are_those_of_the_single_environment(one, many):
    def defaults(builder):
        parameters = inspect.signature(builder).parameters.values()
        return {p.name: p.default for p in parameters if p.kind is not p.VAR_KEYWORD}

    expected = defaults(one)
    if one is make_biped_residual:
        expected = {**defaults(BipedEnv), **expected}
    more = {"num_envs": 1, "autoreset_mode": "NextStep", "max_episode_steps": None}
    assert defaults(many) == {**expected, **more, **({} if one is PendulumEnv else {"threads": 1})}


@pytest.mark.parametrize(
    ("name", "kwargs", "error", "text"),
    [
        (
            PENDULUM,
            {"num_envs": 0},
            InvalidValueError,
            r"must be an integer in \[1, 100000\], got 0",
        ),
        (PENDULUM, {"autoreset_mode": "Later"}, UnknownNameError, "NextStep, SameStep, Disabled"),
        (PENDULUM, {"render_mode": "rgb_array"}, InvalidValueError, "nothing, got render_mode 'rgb_array'"),
        (PENDULUM, {"control_hz": 5}, InvalidValueError, r"control_hz \[Hz\] must be in \[20, 1000\], got 5"),
        (PENDULUM, {"push_distribution": 3}, InvalidValueError, "push_distribution"),
        (RESIDUAL, {"threads": 0}, InvalidValueError, "threads"),
        (RESIDUAL, {"hold": 0}, InvalidValueError, "got 0"),
        (RESIDUAL, {"gate": [1]}, InvalidValueError, "gate"),
        (RESIDUAL, {"scale": -1}, InvalidValueError, "scale"),
    ],
)
def test_bad_arguments(name, kwargs, error, text):
    with pytest.raises(error, match=text):
        native(name, **{"n": kwargs.pop("num_envs", 2), **kwargs})


@pytest.mark.parametrize(
    ("kwargs", "text"),
    [
        ({"seed": [1]}, "seed must be one number or 2, got 1"),
        ({"seed": -1}, "seed must be an integer >= 0, got -1"),
        ({"options": {"mask": 1}}, "scenario, reset_mask"),
        ({"options": {"scenario": ["x", None]}}, "must be a Scenario, got str"),
        ({"options": {"scenario": [None]}}, "one Scenario or 2, got 1"),
        ({"options": {"reset_mask": np.zeros(2, bool)}}, "must be 2 booleans, one of them True"),
        ({"options": {"reset_mask": np.ones(2)}}, "must be 2 booleans"),
    ],
)
def test_bad_resets_change_nothing(kwargs, text):
    env = native(PENDULUM, 2)
    with pytest.raises((InvalidValueError, UnknownNameError), match=text):
        env.reset(**kwargs)
    with pytest.raises(InvalidValueError, match="robot 0 has not begun"):
        env.step(np.zeros((2, 7)))


@pytest.mark.parametrize("bad", [np.zeros((2, 6)), np.zeros(7), [[0] * 6 + [math.nan], [0] * 7], "ab"])
def test_bad_actions(bad):
    env = native(PENDULUM, 2)
    env.reset(seed=0)
    with pytest.raises(InvalidValueError, match="actions"):
        env.step(bad)


def test_without_autoreset_a_step_after_an_end_is_an_error():
    env = native(PENDULUM, 2, autoreset_mode="Disabled")
    env.reset(options={"scenario": [Scenario("a", duration=0.01), Scenario("b", duration=1.0)]})
    assert env.step(np.zeros((2, 7)))[3].tolist() == [True, False]
    with pytest.raises(InvalidValueError, match=r"robots \[0\] have ended"):
        env.step(np.zeros((2, 7)))
    env.reset(seed=0, options={"reset_mask": np.array([True, False])})
    env.step(np.zeros((2, 7)))


ERRORS = (ModelErrors(mass=0.2, dcm_noise=1e-3), ModelErrors(), ModelErrors(slope_left=0.03, delay=0.01))
RANGES = {"mass": [-0.2, 0.2], "delay": [0.0, 0.01], "dcm_noise": [0.0, 0.002]}


def with_errors(errors=ERRORS) -> list[Scenario]:
    return [Scenario(f"s{k}", noise_seed=k, errors=one) for k, one in enumerate(errors)]


@pytest.mark.parametrize("name", [PENDULUM, BIPED])
def test_each_robot_has_its_own_errors_through_partial_resets(name):
    envs, actions = native(name, 3), np.zeros((12, 7), np.float32)
    actions[:, 1] = -0.2
    seen = [envs.reset(options={"scenario": with_errors()})[0]]
    for tick, action in enumerate(actions):
        if tick == 6:  # robot 1 begins anew with the errors of robot 0
            mask = np.array([False, True, False])
            again = [with_errors()[0]] * 3
            envs.reset(options={"scenario": again, "reset_mask": mask})
        seen.append(envs.step(np.repeat(action[None], 3, axis=0))[0])
    envs.close()
    zero, one, two = (np.array([row[0] for row in alone(name, each, actions)]) for each in with_errors())
    expected = zero, np.concatenate([one[:7], zero[1:7]]), two
    np.testing.assert_array_equal(np.array(seen), np.stack(expected, axis=1))


@pytest.mark.parametrize("name", [PENDULUM, BIPED])
def test_errors_are_drawn_anew_for_every_episode(name):
    distribution = {"errors": RANGES}
    envs, drawn = native(name, 3, push_distribution=distribution), []
    for seed in (0, 0, 9):
        envs.reset(seed=seed)
        core = envs.unwrapped.core
        noise = core.errors.noise[:, 0] if name == BIPED else core.errors.deviation
        drawn.append(noise.copy())
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert len(np.unique(drawn)) == 6
    assert 0.0 < np.max(drawn) <= 0.002
    envs.close()
    env = gym.make(name, push_distribution=distribution)
    env.reset(seed=1)
    assert env.unwrapped.scenario.errors.names == ("mass", "delay", "dcm_noise")
    assert env.spec is not None
    assert gym.make(env.spec.from_json(env.spec.to_json())).unwrapped.push_distribution.errors is not None
    env.close()


def test_rewards_and_the_criterion_of_recovery_know_no_noise():
    """Two pendulums under the same actions, one seen with noise: all but what is seen is the same."""
    envs, policy = native(PENDULUM, 2), make_policy("two-stage")
    pair = with_errors((ModelErrors(), ModelErrors(dcm_noise=0.02)))
    envs.reset(options={"scenario": pair})
    for _ in range(300):
        action = policy.predict(envs.unwrapped.core.truth)[0]
        observation, reward, _, _, info = envs.step(action)
        assert reward[0] == reward[1]
        assert info["capture_margin"][0] == info["capture_margin"][1]
        np.testing.assert_array_equal(info["recovered_at"][0], info["recovered_at"][1])
        assert not np.array_equal(observation[0], observation[1])
    assert info["recovered_at"][0] > 0.0
    envs.close()


def test_an_error_that_the_robot_cannot_have_is_named():
    envs = native(PENDULUM, 2)
    with pytest.raises(InvalidValueError, match="the pendulum has no model error 'friction'"):
        envs.reset(options={"scenario": Scenario("a", errors=ModelErrors(friction=0.5))})
    envs.close()
