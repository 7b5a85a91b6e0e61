"""Robots whose joints are acted on, put back: bit for bit, in any place, and only in their own kind."""

import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode.vector_env import GaitVectorEnv
from push_recovery.envs.joint.env import JointEpisodes, JointResidualEpisodes
from push_recovery.envs.joint.taught import TaughtEpisodes
from push_recovery.envs.scenario.push import Push

BEFORE, AFTER = 27, 30
KINDS = [JointEpisodes, JointResidualEpisodes, TaughtEpisodes]
SIZE = {JointEpisodes: 0.15, JointResidualEpisodes: 0.4, TaughtEpisodes: 0.15}  # of the actions


def actions_of(kind, n: int) -> np.ndarray:
    size = SIZE[kind]
    return np.random.default_rng(3).uniform(-size, size, (BEFORE + AFTER, n, 14)).astype(np.float32)


DRIVES = {f"joints.{name}" for name in ("posture", "reach", "stiffness", "damping", "largest", "gait")}


def beside(episodes) -> dict[str, np.ndarray]:
    """Arrays with a row a robot that are no part of a plain biped's arena."""
    parts = episodes.core.own._asdict()
    if isinstance(episodes, JointEpisodes):
        parts["joint_rewards"] = episodes._rewards
    found = {f"{part}.{name}": array for part, own in parts.items() for name, array in own._asdict().items()}
    return {name: array for name, array in found.items() if name not in DRIVES}


def period(episodes, actions) -> np.ndarray:
    """State, observation, reward and the moment of recovery after one period, a row a robot."""
    reward = episodes.step(actions).reward.total
    state = [np.concatenate([data.qpos, data.qvel]) for data in episodes.core.simulations.data]
    judged = episodes.monitor.state.recovered_at
    return np.concatenate([state, episodes.seen, reward[:, None], judged[:, None]], axis=1)


@pytest.fixture(scope="module", params=KINDS)
def walked(request, pushed):
    """Robots in mid-episode, with the true state and with own sensors; snapshots, and what became of them."""
    kind, scenarios = request.param, pushed(4)
    episodes, actions = kind(4), actions_of(request.param, 4)
    for k, scenario in enumerate(scenarios):
        episodes.begin(k, scenario)
    for action in actions[:BEFORE]:
        episodes.step(action)
    snapshots = [pickle.loads(pickle.dumps(episodes.state_snapshot(k))) for k in range(4)]  # noqa: S301
    rows = {name: array.copy() for name, array in beside(episodes).items()}
    future = [period(episodes, action) for action in actions[BEFORE:]]
    return kind, snapshots, rows, actions[BEFORE:], np.array(future)


def put_back(kind, snapshots, left_out: str = ""):
    """Other robots, spoiled and then put where the snapshots were taken, the last one first."""
    episodes = kind(5, threads=2)
    for k in range(5):
        episodes.begin(k, snapshots[k % 4].scenario)
    for _ in range(5):
        episodes.step(np.full((5, 14), 0.1, np.float32))
    for array in beside(episodes).values():
        array[:4] = np.nan if array.dtype == np.float64 else 3
    if left_out:
        snapshots = [
            replace(one, rows={n: r for n, r in one.rows.items() if n != left_out}) for one in snapshots
        ]
        whole = episodes._arrays
        episodes._arrays = lambda k: {name: row for name, row in whole(k).items() if name != left_out}
    for k, snapshot in enumerate(snapshots):
        episodes.restore(3 - k, snapshot)
    return episodes


def test_a_robot_put_back_goes_on_as_the_original_in_any_place(walked):
    kind, snapshots, rows, actions, future = walked
    episodes = put_back(kind, snapshots)
    for name, array in beside(episodes).items():
        np.testing.assert_array_equal(array[3::-1], rows[name], name)
    for action, then in zip(actions, future, strict=True):
        now = period(episodes, np.concatenate([action[::-1], action[:1]]))
        np.testing.assert_array_equal(now[3::-1], then)
    assert np.abs(future[-1] - future[0])[:, :21].max(axis=1).min() > 1e-3  # they move
    assert (episodes.failure()[:4] == 0).any()


def test_an_array_that_is_left_out_is_noticed(walked):
    """Each array beside the arena is in the snapshot; most would change what comes, all what is held."""
    kind, snapshots, rows, *_ = walked
    for left_out in rows:
        assert left_out in snapshots[0].rows
        array = beside(put_back(kind, snapshots, left_out))[left_out]
        if np.any(rows[left_out] != rows[left_out].flat[0]):
            assert not np.array_equal(array[3::-1], rows[left_out]), left_out


def test_another_push_may_follow_the_same_walk(pushed):
    scenario = replace(pushed(1)[0], pushes=(), duration=9.0)
    envs = GaitVectorEnv(JointEpisodes(2), autoreset_mode="Disabled")
    envs.reset(options={"scenario": scenario})
    action = np.zeros((2, 14), np.float32)
    for _ in range(20):
        envs.step(action)
    snapshot = envs.state_snapshot(1)
    push = Push((40.0, -200.0, 0.0), 0.1, snapshot.time)
    asked = replace(scenario, id="pushed", pushes=(push,), duration=None)
    _, info = envs.restore(snapshot, [0], asked)
    assert info["scenario_id"][0] == "pushed"
    for _ in range(11):
        seen = envs.step(action)[0]
    assert envs.core.pushes.delivered[0, 0, 1] == pytest.approx(-20.0)
    assert np.abs(seen[0] - seen[1]).max() > 0.05


def test_the_planner_below_plans_anew_where_a_robot_is_put_back(pushed):
    env = gym.make("push_recovery:PushRecovery/BipedJointResidual-v0").unwrapped
    env.reset(options={"scenario": pushed(1)[0]})
    env.step(np.zeros(14))
    snapshot = env.state_snapshot()
    _, info = env.restore(snapshot)
    assert "baseline_action" not in info


def test_only_robots_of_the_same_kind_are_put_back(pushed):
    snapshots = []
    for kind in (BipedEpisodes, JointEpisodes, JointResidualEpisodes):
        episodes = kind(1)
        episodes.begin(0, pushed(1)[0])
        snapshots.append(episodes.state_snapshot(0))
        for other in snapshots[:-1]:
            with pytest.raises(InvalidValueError, match="taken of another form of the biped"):
                episodes.restore(0, other)
    with pytest.raises(InvalidValueError, match="taken of another form of the biped"):
        BipedEpisodes(1).restore(0, snapshots[1])
    with pytest.raises(InvalidValueError, match="taken of another set of drives"):
        JointResidualEpisodes(1, scale=0.1).restore(0, snapshots[2])
    with pytest.raises(InvalidValueError, match="taken of another planner below"):
        JointResidualEpisodes(1, gate=None).restore(0, snapshots[2])
