"""Sampling MPC on the biped: without a push, with one, and where it may not act."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import polar_push
from push_recovery.envs.scenario.scenario import HARDWARE, Command, Scenario
from push_recovery.envs.wrappers import ActionHold
from push_recovery.eval import sampling_mpc as source
from push_recovery.eval.output.progress import episode_seconds
from push_recovery.eval.play.session import Session
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.rollout.load_policy import load_policy, make_policy, policy_names
from push_recovery.eval.rollout.policy_source import PolicySource, guessed_seconds, policy_sources
from push_recovery.eval.sampling_mpc import Memory, SamplingMpcPolicy, SamplingMpcSettings

FEW = SamplingMpcSettings(population=16, elites=4)
HARD = Scenario("hard", (polar_push(2000.0, 0.0, 0.1, 0.4),), settle_time=3.0)


@pytest.fixture(scope="module")
def env() -> gym.Env:
    return make_env("PushRecovery/Biped-v0")


def outcome(env, policy, scenario) -> dict:
    return {**rollout(env, policy, scenario, "").to_dict(), "policy": ""}


def played(env, policy, scenario, periods: int) -> list[tuple[np.ndarray, Memory]]:
    """Action and memory of the periods of a scenario."""
    seen, _ = env.reset(options={"scenario": scenario})
    state, found = None, []
    for _ in range(periods):
        action, state = policy.predict(seen, state)
        seen, _, over, _, _ = env.step(action)
        assert not over
        found.append((action, state))
    return found


def test_unpushed_it_is_the_planner_bit_for_bit(env):
    calm = Scenario("calm", command=Command(0.3, 0.1, 0.2), duration=2.0)
    policy = SamplingMpcPolicy(env, FEW)
    assert outcome(env, policy, calm) == outcome(env, load_policy("two-stage", env), calm)
    assert {memory.since_push for _, memory in played(env, policy, calm, 20)} == {10**9}


def test_a_push_that_the_planner_survives_leaves_its_actions_alone(env):
    light = Scenario("light", (polar_push(300.0, 1.0, 0.1, 0.4),), settle_time=1.5)
    row = outcome(env, SamplingMpcPolicy(env, FEW), light)
    assert row == outcome(env, load_policy("two-stage", env), light)
    assert row["survived"]


def test_it_recovers_where_the_planner_falls_and_again_bit_for_bit(env):
    policy = SamplingMpcPolicy(env, FEW)
    first = outcome(env, policy, HARD)
    assert first["recovered"]
    assert not outcome(env, load_policy("two-stage", env), HARD)["survived"]
    outcome(env, policy, replace(HARD, pushes=(polar_push(1500.0, 2.0, 0.1, 0.4),), duration=0.7))
    assert outcome(env, policy, HARD) == first
    assert outcome(env, SamplingMpcPolicy(env, FEW), HARD) == first
    other = SamplingMpcPolicy(env, replace(FEW, seed=1))
    assert outcome(env, other, HARD) != first


def test_what_is_to_come_changes_no_action(env):
    """Until a second push comes, or the first one goes on for longer than it did elsewhere."""
    policy = SamplingMpcPolicy(env, FEW)
    one = played(env, policy, HARD, 53)
    twice = replace(HARD, pushes=(*HARD.pushes, polar_push(900.0, 2.0, 0.1, 0.525)))
    longer = replace(HARD, pushes=(polar_push(2000.0, 0.0, 0.15, 0.4),))
    # The observation of 0.53 s (0.51 s) is the first to differ, and the action there.
    for coming, same in ((twice, 53), (longer, 51)):
        other = played(env, policy, coming, 53)
        for period, ((action, _), (own, _)) in enumerate(zip(other, one, strict=True)):
            assert np.array_equal(action, own) == (period < same), period


def test_it_notices_a_push_when_the_robot_is_not_where_it_was_to_be(env):
    """The push acts from 0.405 to 0.425 s: felt in the periods that end at 0.41, 0.42 and 0.43 s."""
    brief = Scenario("brief", (polar_push(100.0, 1.0, 0.02, 0.405),), duration=2.0)
    found = played(env, SamplingMpcPolicy(env, FEW), brief, 60)
    since = [memory.since_push for _, memory in found]
    assert since[:41] == [10**9] * 41
    assert since[41:48] == [0, 0, 0, 1, 2, 3, 4]


def test_corrections_move_on_with_the_steps(env):
    """Once found, a plan stays; its first row goes when a step ends, and a row of zeros comes last."""
    found = played(env, SamplingMpcPolicy(env, FEW), HARD, 120)
    plans = [memory.plan for _, memory in found]
    ends = [i for i in range(1, 120) if found[i][1].elapsed < found[i - 1][1].elapsed]
    shifted = [i for i in ends if np.any(plans[i - 1])]
    assert shifted
    assert not np.any(plans[39])
    for i in shifted:
        if found[i - 1][1].stands and found[i][1].stands and np.any(plans[i]):
            np.testing.assert_array_equal(plans[i], np.vstack([plans[i - 1][1:], np.zeros((1, 7))]))
            break
    else:
        pytest.fail("no plan has gone on over the end of a step")


def test_it_acts_by_name_and_its_rows_hang_on_its_source(env, monkeypatch, tmp_path):
    assert "sampling-mpc" in policy_names()
    policy = make_policy("sampling-mpc", env)
    assert isinstance(policy, SamplingMpcPolicy)
    assert policy.settings == SamplingMpcSettings()
    digest = PolicySource("a label", "sampling-mpc").digest()
    assert digest is not None
    assert len(digest) == 64
    monkeypatch.setattr(source, "__file__", str(tmp_path / "sampling_mpc.py"))
    for name in ("search.py", "sampling_mpc.py"):
        (tmp_path / name).write_text("changed")
    assert PolicySource("a label", "sampling-mpc").digest() != digest


def test_bodies_that_collide_do_so_in_its_copies(env):
    """So the robot is where its copy is, from the period on after that in which the push has ended."""
    push = replace(HARD.pushes[0], start=0.405)
    colliding = replace(HARD, pushes=(push,), errors=ModelErrors(collisions=True))
    found = played(env, SamplingMpcPolicy(env, FEW), colliding, 80)
    since = [memory.since_push for _, memory in found]
    assert since == 41 * [10**9] + 11 * [0] + list(range(1, 29))


@pytest.mark.parametrize("scenario", [HARDWARE.applied(HARD), replace(HARD, errors=ModelErrors(mass=0.05))])
def test_a_robot_that_is_not_exact_is_refused(env, scenario):
    with pytest.raises(InvalidValueError) as error:
        rollout(env, SamplingMpcPolicy(env, FEW), scenario, "")
    assert str(error.value) == (
        "policy 'sampling-mpc' simulates the robot as it is and starts from its true state: it acts on exact "
        "robots alone, and scenario 'hard' has errors of the model or own sensors"
    )


def test_a_robot_with_sensors_of_its_own_is_refused_before_it_walks():
    onboard = make_env("PushRecovery/Biped-v0", sensing="onboard")
    with pytest.raises(InvalidValueError, match="acts on exact robots alone"):
        rollout(onboard, SamplingMpcPolicy(onboard, FEW), HARD, "")
    session = Session("PushRecovery/Biped-v0", "two-stage", start=HARDWARE.applied(Scenario("s")))
    with pytest.raises(InvalidValueError, match="acts on exact robots alone"):
        session.switch("sampling-mpc")
    session.step()


def test_the_observation_of_another_robot_is_refused(env):
    policy, other = SamplingMpcPolicy(env, FEW), make_env("PushRecovery/Biped-v0")
    env.reset(options={"scenario": HARD})
    seen, _ = other.reset(options={"scenario": replace(HARD, command=Command(0.2))})
    with pytest.raises(InvalidValueError) as error:
        policy.predict(seen)
    assert str(error.value) == (
        "policy 'sampling-mpc' acts on the robot of the environment that it was made with, and this "
        "observation is another one's"
    )


def test_a_new_episode_begins_with_an_empty_memory(env):
    policy = SamplingMpcPolicy(env, FEW)
    _, old = played(env, policy, HARD, 60)[-1]
    seen, _ = env.reset(options={"scenario": HARD})
    _, state = policy.predict(seen, old, episode_start=np.array([True]))
    assert state.since_push == 10**9
    assert not np.any(state.plan)
    _, state = policy.predict(seen, old, episode_start=np.array([False]))
    assert state.since_push == 0


@pytest.mark.parametrize(
    ("env_id", "said"),
    [
        ("Pendulum-v0", "acts on one biped under plain gait actions, such as PushRecovery/Biped-v0"),
        ("BipedResidual-v0", "gives whole actions, but this environment takes residuals"),
        ("BipedJoint-v0", "gives gait actions, but"),
    ],
)
def test_another_environment_is_refused(env_id, said):
    with pytest.raises(InvalidValueError, match=f"^policy 'sampling-mpc' {said}"):
        load_policy("sampling-mpc", make_env(f"PushRecovery/{env_id}"))


def test_robots_of_a_vector_and_held_actions_are_refused(env):
    robots = gym.make_vec("PushRecovery/Biped-v0", num_envs=2)
    for other in (robots, ActionHold(env, 2)):
        with pytest.raises(InvalidValueError, match="acts on one biped"):
            make_policy("sampling-mpc", other)
    robots.close()
    assert make_policy("sampling-mpc", gym.make("PushRecovery/Biped-v0"))


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("population", 1, r"SamplingMpcSettings.population must be an integer"),
        ("elites", 65, r"SamplingMpcSettings.elites must be at most the population 64, got 65"),
        ("horizon", 0.0, r"SamplingMpcSettings.horizon must be"),
        ("outlast", -0.1, r"SamplingMpcSettings.outlast must be"),
    ],
)
def test_impossible_settings_are_refused(field, value, said):
    with pytest.raises(InvalidValueError, match=said):
        SamplingMpcSettings(**{field: value})


def test_a_run_says_that_it_takes_longer_than_the_planners():
    sources = policy_sources(["sampling-mpc", "two-stage"])
    calm = Scenario("calm", duration=10.0)
    alone = episode_seconds("PushRecovery/Biped-v0", [calm])
    planners = {"two-stage": [calm]}
    for missing, times in ((planners, 1), ({**planners, "sampling-mpc": [calm] * 2}, 51)):
        guess = guessed_seconds("PushRecovery/Biped-v0", missing, sources, 2)
        assert guess == pytest.approx(8.0 + times * alone / 2)  # 8 s until both processes have begun
    assert guessed_seconds("PushRecovery/Biped-v0", planners, sources, 1) == pytest.approx(alone)
    assert guessed_seconds("PushRecovery/Biped-v0", {"two-stage": []}, sources, 2) == 0.0
