"""Robots under training: what the network is told of them, and what its outputs do."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.training.builders import completed, make_env, make_robots, make_starts
from push_recovery.training.settings import TrainingSettings
from push_recovery.training.vec_env import TrainingRobots

PENDULUM, BIPED, JOINT, JOINT_RESIDUAL = (
    f"PushRecovery/{name}-v0" for name in ("Pendulum", "Biped", "BipedJoint", "BipedJointResidual")
)
SETTINGS = TrainingSettings(env_id=BIPED, n_envs=3, walks=3, hold=2)


def robots_of(settings, seed=0):
    env = make_env(settings)
    return make_robots(completed(settings, env), env, seed)


@pytest.mark.parametrize(
    ("kind", "env_id", "starts", "inputs"),
    [
        ("residual", BIPED, "push", ("observation", "base", "gate", "margin")),
        ("scratch", BIPED, "push", ("observation", "margin")),
        ("residual", PENDULUM, "reset", ("observation", "base", "gate", "margin")),
        ("joint", JOINT, "reset", ("observation",)),
        ("joint-residual", JOINT_RESIDUAL, "push", ("observation",)),
    ],
)
def test_what_is_left_open_is_settled_by_the_environment(kind, env_id, starts, inputs):
    settings = TrainingSettings(kind=kind, env_id=env_id)
    whole = completed(settings, make_env(settings))
    reward = "environment" if kind == "joint" else "recovery"
    assert (whole.starts, whole.reward, whole.inputs) == (starts, reward, inputs)
    assert completed(whole, make_env(whole)) == whole


def test_an_input_that_there_is_not_is_refused():
    with pytest.raises(InvalidValueError, match="no input 'margin'; choose from: observation"):
        robots_of(TrainingSettings(kind="joint", env_id=JOINT, inputs=("observation", "margin")))
    with pytest.raises(InvalidValueError, match="only a residual has the input 'base'"):
        TrainingSettings(kind="scratch", inputs=("observation", "base"))


def test_an_environment_of_others_has_its_own_reward_and_starts(toy):
    settings = TrainingSettings(kind="scratch", env_id=toy)
    whole = completed(settings, make_env(settings))
    assert (whole.starts, whole.reward, whole.inputs) == ("reset", "environment", ("observation",))
    for wrong, told in (
        ({"starts": "push"}, "trained with starts 'reset', not 'push'"),
        ({"reward": "recovery"}, "trained with reward 'environment', not 'recovery'"),
    ):
        with pytest.raises(InvalidValueError, match=told):
            completed(dataclasses.replace(settings, **wrong), make_env(settings))


def test_an_untrained_residual_does_what_the_planner_does_and_sees_it():
    robots = robots_of(SETTINGS)
    seen = robots.reset()
    assert seen.shape == (3, 45)
    episodes = robots.episodes
    planner = make_env(SETTINGS).env.policy
    for _ in range(10):
        base = planner.predict(episodes.core.observation)[0]
        np.testing.assert_array_equal(seen[:, :36], episodes.core.observation.astype(np.float32))
        np.testing.assert_array_equal(seen[:, 36:43], base)
        np.testing.assert_allclose(seen[:, 44], np.clip(episodes.core.margin, -0.5, 0.5), atol=1e-6)
        assert ((seen[:, 43] >= 0.0) & (seen[:, 43] <= 1.0)).all()
        before = episodes.motion().time.copy()
        seen, _, dones, _ = robots.step(np.zeros((3, 7), np.float32))
        assert not dones.any()
        np.testing.assert_allclose(episodes.motion().time - before, 0.02)
    assert (seen[:, 43] > 0.0).any()  # a push opens the gate


def test_robots_are_quiet_where_a_gate_keeps_what_is_learned_out():
    """With no gate something learned always acts, so that an episode goes on after a recovery."""
    acting = robots_of(TrainingSettings("scratch", n_envs=2, walks=2))
    acting.reset()
    assert not acting._actor.gate_closed.any()
    robots = robots_of(TrainingSettings("joint-residual", n_envs=4, walks=4, easy_share=0.0))
    robots.reset()
    gate, quiet = robots.episodes.gate, []
    for _ in range(40):
        np.testing.assert_array_equal(
            robots._actor.gate_closed, gate(robots.episodes.core.observation)[:, 0] == 0.0
        )
        quiet.append(robots._actor.gate_closed.copy())
        robots.step(np.zeros((4, 14), np.float32))
    assert np.array(quiet[0]).all()  # the push is still to come
    assert not np.array(quiet).all()


def test_an_ended_episode_begins_anew_and_tells_how_it_ended():
    """At full outputs every robot falls; then it is in another walk."""
    robots = robots_of(dataclasses.replace(SETTINGS, gate=None))
    robots.reset()
    worst = np.array([[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]] * 3, np.float32)
    ended = []
    for _ in range(120):
        seen, rewards, dones, infos = robots.step(worst)
        for k in np.flatnonzero(dones):
            ended.append((infos[k]["failure_reason"], rewards[k]))
            assert infos[k]["terminal_observation"].shape == (45,)
            assert not np.array_equal(infos[k]["terminal_observation"], seen[k])
            assert infos[k]["TimeLimit.truncated"] is False
            assert robots.episodes.motion().time[k] > 1.0  # in a walk
        assert all(info == {"TimeLimit.truncated": False} for info in np.array(infos)[~dones])
    assert len(ended) >= 3
    assert all(reason is not None and reward < -0.3 for reason, reward in ended)


def test_the_time_limit_is_told_where_the_value_goes_on():
    settings = dataclasses.replace(
        SETTINGS, env_id=PENDULUM, reward="environment", pushes=dataclasses.replace(
            SETTINGS.pushes, impulse_min=5.0, impulse_max=10.0, settle_time=0.5, first_step=0,
        ),
    )  # fmt: skip
    robots, infos = robots_of(settings), []
    robots.reset()
    for _ in range(100):
        _, rewards, dones, told = robots.step(np.zeros((3, 7), np.float32))
        infos += [told[k] for k in np.flatnonzero(dones)]
    assert infos
    assert all(info["TimeLimit.truncated"] and info["failure_reason"] is None for info in infos)
    assert (rewards > 1.0).all()  # two periods of the environment's own


def test_seeds_give_the_same_pushes_and_others_others():
    def some(seed):
        robots = robots_of(SETTINGS, seed)
        rows = [robots.reset()]
        return np.array(rows + [robots.step(np.full((3, 7), 0.1, np.float32))[0] for _ in range(10)])

    first = some(4)
    assert np.array_equal(first, some(4))
    assert not np.array_equal(first, some(5))


class Told:
    """Robots, actor, starts and reward in one, whose course a test says; notes what it is asked for.

    Of four robots 1 falls in the second period, after it had recovered, and 2 recovers in the third.
    """

    n = size = 4
    action_size, failures, bootstraps = 1, (None, "low"), True
    gate_closed = np.zeros(4, np.bool_)

    def __init__(self):
        self.notes, self.periods, self.fresh = [], 0, 0.0
        self.monitor = SimpleNamespace(recovered_at={1: 0.5, 2: 0.7, 3: None}.get)

    def step(self, actions):
        self.notes.append(("step", actions[:, 0].tolist()))
        self.periods += 1
        return SimpleNamespace(failed=np.array([False, self.periods >= 2, False, False]))

    def failure(self):
        return np.array([0, 1, 0, 0])

    def actions(self, outputs):
        return outputs

    def look(self, rows):
        self.notes.append(("look", rows.tolist()))

    def inputs(self):
        return np.repeat(self.fresh + np.arange(4.0)[:, None], 4, axis=1).astype(np.float32)

    def begin(self, which):
        self.notes.append(("begin", np.atleast_1d(which).tolist()))
        self.fresh = 100.0

    def ended(self, k, recovered):
        self.notes.append(("ended", k, recovered))

    def period(self, period, live, gate_closed):
        ends = {2: [False, True, False, False], 3: [False, False, True, True]}
        return live & np.array(ends.get(self.periods, [False] * 4))

    def collect(self, over):
        return np.where(over, 5.0, 0.25)


def test_robots_are_led_through_a_held_action_and_each_end_is_told_where_it_comes():
    told = Told()
    robots = TrainingRobots(told, told, told, told, 3)
    seen, rewards, dones, infos = robots.step(np.array([[2.0], [-3.0], [0.5], [0.0]]))
    steps = [note for note in told.notes if note[0] == "step"]
    assert steps == [("step", [1.0, -1.0, 0.5, 0.0])] * 3  # clipped
    looks = [rows for what, rows, *_ in told.notes if what == "look"]
    assert looks == [[0, 1, 2, 3], [0, 1, 2, 3], [0, 2, 3], [1, 2, 3]]
    ends = [note[1:] for note in told.notes if note[0] == "ended"]
    assert ends == [(1, False), (2, True), (3, False)]  # one that fell has not recovered
    begun = [rows for what, rows, *_ in told.notes if what == "begin"]
    assert begun == [[1], [2], [3], [1, 2, 3]]  # starts, and then the reward
    assert (rewards.tolist(), dones.tolist()) == ([0.25, 5.0, 5.0, 5.0], [False, True, True, True])
    assert seen[:, 0].tolist() == [100.0, 101.0, 102.0, 103.0]  # of the next episode
    assert infos[0] == {"TimeLimit.truncated": False}
    for k, reason, recovered_at in ((1, "low", 0.5), (2, None, 0.7), (3, None, None)):
        last = infos[k].pop("terminal_observation")
        assert last.tolist() == [float(k)] * 4
        limit = reason is None
        expected = {"failure_reason": reason, "recovered_at": recovered_at, "TimeLimit.truncated": limit}
        assert infos[k] == expected


def test_starts_are_those_of_the_settings_for_a_robot_of_half_the_mass():
    settings = TrainingSettings(
        starts="reset", easy_share=0.25, least_acceptance=0.2, easy=(5.0, 80.0), like=("quick",), retries=3
    )
    episodes = SimpleNamespace(n=1, robot=RobotModel(mass=30.0))
    begin = make_starts(settings, episodes, 0)  # type: ignore[arg-type]
    assert (begin.easy_share, begin.floor, begin.retries) == (0.25, 0.2, 3)
    assert begin.pushes.impulse_max == pytest.approx(0.5 * settings.pushes.impulse_max)
    assert (begin.easy.impulse_min, begin.easy.impulse_max) == pytest.approx((2.5, 40.0))
    assert (begin.like.kinds, begin.like.size.mass) == (("quick",), 0.5)
    assert begin.tables["pelvis single"].width == pytest.approx(10.0)


def test_the_potential_is_discounted_by_the_gamma_of_the_settings():
    """gamma phi' - phi, phi = 2 clip(m, -0.3, 0.05), of robots whose episodes go on."""
    robots = robots_of(TrainingSettings(
        env_id=PENDULUM, n_envs=2, hold=1, starts="reset", reward="recovery", gamma=0.5
    ))  # fmt: skip
    robots.reset()
    before = 2.0 * np.clip(robots.episodes.core.margin, -0.3, 0.05)
    _, rewards, dones, _ = robots.step(np.zeros((2, 7), np.float32))
    after = 2.0 * np.clip(robots.episodes.core.margin, -0.3, 0.05)
    assert not dones.any()
    assert (after != 0.0).all()
    np.testing.assert_allclose(rewards, 0.5 * after - before, atol=1e-6)
