"""A robot put back goes on bit for bit as the original did: in any slot, whatever was there before."""

import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.array_table import COMMON, NO_STATE, SENSED
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode.vector_env import GaitVectorEnv
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.scenario.disturbances import Platform, Slip
from push_recovery.envs.scenario.model_errors import ModelErrors, PhysicsOptions
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import HARDWARE, Command, CommandChange, Scenario
from push_recovery.envs.scenario.terrain import Stairs
from push_recovery.envs.snapshot import arrays_of
from push_recovery.envs.wrappers import ResidualVectorEnv

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
PUSH = Push((120.0, 250.0, 0.0), 0.1, GaitEvent(1, "left", 0.3), "trunk", (0.0, 0.02, 0.1), "heading")
LATE = Push((-60.0, 90.0, 0.0), 0.05, 1.45)
TOLD = (CommandChange(0.4, Command(0.1, 0.0, 0.2)), CommandChange(1.3, Command(0.0, 0.1)))
NOISY = ModelErrors(mass=0.1, delay=0.006, dcm_noise=0.003, joint_noise=0.001, slope_left=0.03)
STAIRS = Stairs(0.1, 2, start=0.3, tread=0.35)  # whose first step is climbed about when it is put back
SCENARIOS = (
    Scenario("exact", (PUSH, LATE), Command(0.2), "right", changes=TOLD),
    HARDWARE.applied(Scenario("hardware", (PUSH,), Command(0.0, 0.1), noise_seed=4)),
    Scenario(
        "tiles", (LATE,), Command(0.5), noise_seed=5, errors=ModelErrors(floor_step=0.012, collisions=True)
    ),
    Scenario("noisy", (PUSH,), noise_seed=6, errors=NOISY, sensing="onboard"),
    Scenario("stairs", (LATE,), Command(0.3), errors=ModelErrors(terrain=STAIRS, floor_known=True)),
    Scenario("rk4", (PUSH,), noise_seed=7, errors=NOISY, physics=PhysicsOptions(0.001, "rk4")),
)
VARIANTS = "push_recovery.envs.robots.biped"
BEFORE, AFTER = 78, 100  # periods: a first push is on or over, a second one and a command are to come


def vector(n: int, **kwargs) -> GaitVectorEnv:
    return GaitVectorEnv(BipedEpisodes(n, **kwargs), autoreset_mode="Disabled")


def act(envs) -> tuple:
    return envs.step(POLICY.predict(envs.core.observation)[0])


def arrays_in(episodes: BipedEpisodes, left_out=(NO_STATE,), only: str = "") -> dict[str, np.ndarray]:
    """Arrays that compiled code is handed, under the kind of sensing, part and field."""
    found = {}
    for kind, arenas in enumerate(episodes.core._arenas):
        arrays = arrays_of(arenas[0], left_out, only)
        if kind and not only:
            estimate = episodes.core.senses.kinds[kind].estimate
            arrays |= {f"estimate.{field}": array for field, array in estimate._asdict().items()}
        found |= {f"{kind} {name}": array for name, array in arrays.items()}
    return found


def of_robots(episodes: BipedEpisodes) -> dict[str, np.ndarray]:
    """Those of them that have a row a robot, and what judges the robots."""
    found = arrays_in(episodes, (NO_STATE, COMMON))
    for name, part in (("episodes", episodes._episodes), ("monitor", episodes.monitor.state)):
        found |= {f"{name}.{field}": array for field, array in part._asdict().items()}
    return {name: array for name, array in found.items() if len(array) == episodes.n}


def poison(episodes: BipedEpisodes, k: int) -> None:
    """Spoil all that is known of robot k."""
    for array in of_robots(episodes).values():
        array[k] = np.nan if array.dtype == np.float64 else 3
    data = episodes.core.simulations.data[k]
    for name in ("qpos", "qvel", "qacc_warmstart", "ctrl", "xfrc_applied", "sensordata", "qfrc_constraint"):
        getattr(data, name)[:] = np.nan
    for believed in episodes.core.simulations._belief:
        believed.qpos[:] = believed.qvel[:] = np.nan


@pytest.fixture(scope="module")
def walked():
    """Robots in mid-episode, and a snapshot of each."""
    envs = vector(len(SCENARIOS))
    envs.reset(options={"scenario": list(SCENARIOS)})
    for _ in range(BEFORE):
        act(envs)
    return envs, [envs.state_snapshot(k) for k in range(envs.num_envs)]


@pytest.fixture(scope="module")
def futures(walked):
    """What becomes of them: (periods, n) of observation, truth, world, reward and ends."""
    envs, snapshots = walked
    own = vector(envs.num_envs)
    own.reset(options={"scenario": list(SCENARIOS)})
    for _ in range(BEFORE):
        act(own)
    assert len({snapshot.time for snapshot in snapshots}) == 1
    return [going_on(own) for _ in range(AFTER)]


def going_on(envs) -> tuple[np.ndarray, ...]:
    envs._ended[:] = False  # robots that have fallen rest
    _, reward, terminated, truncated, _ = act(envs)
    core = envs.core
    parts = core.observation, core.truth, core.world, core.margin, reward, terminated, truncated
    return tuple(part.copy() for part in parts)


def test_what_all_robots_have_in_common_is_what_does_not_grow_with_their_number():
    few, more = (vector(n) for n in (3, 19))
    for envs in (few, more):
        envs.reset(options={"scenario": SCENARIOS[1]})
    small, large = (arrays_in(envs.episodes) for envs in (few, more))
    own = {name for name in small if name.startswith("1 ")}  # of robots with sensors
    grows = {name for name in own if len(small[name]) == 3 and len(large[name]) == 19}
    assert own - grows == {name for name in arrays_in(few.episodes, only=COMMON) if name.startswith("1 ")}
    sensed = arrays_of(few.core._arenas[1][0], {COMMON}, only=SENSED)
    assert {f"1 {name}" for name in sensed} < grows


@pytest.mark.parametrize("threads", [1, 2])
def test_a_robot_put_back_goes_on_as_the_original_in_any_slot(walked, futures, threads):
    envs, snapshots = walked
    n, order = 8, [5, 0, 3, 6, 1, 7]  # the others stay
    others = vector(n, threads=threads)
    others.reset(options={"scenario": [SCENARIOS[k % len(SCENARIOS)] for k in range(n)]})
    for _ in range(20):
        act(others)
    for k in order:
        poison(others.episodes, k)
    others.restore([pickle.loads(pickle.dumps(one)) for one in snapshots], order)  # noqa: S301
    source, here = of_robots(envs.episodes), of_robots(others.episodes)
    taken = {
        "pushes": [len(one.pushes) for one in SCENARIOS],
        "schedule": [len(one.changes) for one in SCENARIOS],
    }
    assert len(source) > 150
    for k, to in enumerate(order):
        sensed = bool(envs.core.senses.of(k))
        for name, array in source.items():
            part = name[2:].partition(".")[0]
            if sensed or part not in {"sensed", "sensors", "estimate", "judged", "judged_contacts"}:
                row, there = array[k], here[name][to]
                if part in {"pushes", "schedule"} and np.ndim(row):  # there may be more room than is taken
                    row, there = row[: taken[part][k]], there[: taken[part][k]]
                np.testing.assert_array_equal(there, row, name)
    for k, to in enumerate(order):
        for name in ("qpos", "qvel", "qacc_warmstart", "sensordata", "qfrc_constraint", "geom_xpos"):
            was, now = (
                getattr(core.simulations.data[i], name) for core, i in ((envs.core, k), (others.core, to))
            )
            np.testing.assert_array_equal(now, was, name)
    for then in futures:
        for part, now in zip(then, going_on(others), strict=True):
            np.testing.assert_array_equal(now[order], part)


def test_what_is_compared_moves_and_is_pushed(walked, futures):
    _, snapshots = walked
    begun = [np.any(snapshot.rows["pushes.start"] < snapshot.time) for snapshot in snapshots]
    assert begun == [True, True, False, True, False, True]
    assert np.abs(futures[-1][0] - futures[0][0]).max(axis=1).min() > 1e-3
    assert not futures[40][5].any()  # nobody lies on the floor all along


def test_another_push_may_follow_the_same_walk():
    """A walk without pushes, put back with one to come, is the episode that had it all along."""
    walk, envs = Scenario("walk", command=Command(0.1), duration=9.0), vector(2)
    envs.reset(options={"scenario": walk})
    for _ in range(BEFORE):
        act(envs)
    snapshot = envs.state_snapshot(1)
    step = int(envs.core.gait.steps[1])
    push = Push((40.0, -200.0, 0.0), 0.1, GaitEvent(step + 1, "left", 0.4))
    pushed = replace(walk, id="pushed", pushes=(push, replace(LATE, start=2.0)), duration=None)
    whole = vector(1)
    whole.reset(options={"scenario": pushed})
    for _ in range(BEFORE):
        act(whole)
    _, info = envs.restore(snapshot, [0], pushed)
    assert info["scenario_id"][0] == "pushed"
    assert info["_scenario_id"].tolist() == [True, False]
    for _ in range(AFTER):
        then, now = act(whole), act(envs)
        np.testing.assert_array_equal(now[0][0], then[0][0])
        assert now[1][0] == then[1][0]
    assert envs.core.pushes.delivered[0].tolist() == whole.core.pushes.delivered[0].tolist()
    assert envs.core.pushes.delivered[0, 0, 1] == pytest.approx(-20.0)
    assert envs.episodes._episodes.fixed[0] != envs.episodes._episodes.fixed[0]  # NaN: ends after the pushes


def test_a_single_environment_takes_and_gives_snapshots(walked, futures):
    _, snapshots = walked
    env = gym.make("push_recovery:PushRecovery/Biped-v0").unwrapped
    observation, info = env.restore(snapshots[0])
    assert info["scenario_id"] == "exact"
    assert env.scenario is SCENARIOS[0]
    for then in futures[:20]:
        observation = env.step(POLICY.predict(observation)[0])[0]
        np.testing.assert_array_equal(observation, then[0][0])
    again = vector(2)
    again.reset(options={"scenario": SCENARIOS[1]})
    observation = again.restore(env.state_snapshot(), [1])[0]
    for then in futures[20:40]:
        observation = act(again)[0]
        np.testing.assert_array_equal(observation[1], then[0][0])


def test_residual_environments_put_robots_back_too(walked, futures):
    _, snapshots = walked
    envs = ResidualVectorEnv(BipedEpisodes(2), hold=2)
    envs.reset(options={"scenario": SCENARIOS[2]})
    envs.step(np.zeros((2, 7)))
    _, info = envs.restore(snapshots[0], [1])
    assert info["_baseline_action"].tolist() == [False, False]
    single = gym.make("push_recovery:PushRecovery/BipedResidual-v0", hold=2)
    single.reset(seed=0)
    single.step(np.zeros(7))
    single.get_wrapper_attr("restore")(snapshots[0])
    for then in futures[1:40:2]:
        np.testing.assert_array_equal(envs.step(np.zeros((2, 7)))[0][1], then[0][0])
        np.testing.assert_array_equal(single.step(np.zeros(7))[0], then[0][0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"command": Command(0.21)}, "must have its command"),
        ({"noise_seed": 1}, "must have its noise_seed, 0, got 1"),
        ({"errors": ModelErrors(mass=0.1)}, "must have its errors"),
        ({"sensing": "onboard"}, "must have its sensing"),
        ({"changes": TOLD[1:]}, "changes of command that came before"),
        ({"changes": (*TOLD[:1], CommandChange(0.5, Command()))}, "changes of command that came before"),
        ({"pushes": (LATE,)}, "push 0 of the snapshot began at"),
        ({"pushes": (replace(PUSH, duration=0.2),)}, "push 0 of the snapshot began at"),
        ({"pushes": (PUSH, replace(LATE, start=0.3))}, "push 1 would begin before"),
        ({"pushes": (PUSH, replace(PUSH, body="pelvis"))}, "push 1 would begin before"),
    ],
)
def test_a_scenario_that_differs_in_what_has_happened_is_refused(walked, change, message):
    envs, snapshots = walked
    with pytest.raises(InvalidValueError, match=message):
        envs.restore(snapshots[0], [0], replace(SCENARIOS[0], **change))


def test_what_is_to_come_may_change(walked):
    _, snapshots = walked
    envs, asked = vector(1), replace(SCENARIOS[0], id="b", pushes=(PUSH,), changes=TOLD[:1], duration=3.0)
    envs.restore(snapshots[0], scenario=asked)
    assert envs.core.pushes.start[0, 1:].tolist() in ([], [np.inf])
    assert envs.episodes._episodes.fixed[0] == 3.0
    assert envs.core.gait.time[0] == snapshots[0].time


def test_a_new_command_must_come_after_the_snapshot_and_is_followed(walked):
    _, snapshots = walked
    envs, snapshot, action = vector(1), snapshots[0], np.zeros((1, 7), np.float32)
    now, command = snapshot.time, Command(0.05, -0.1, 0.1)
    at_once = replace(SCENARIOS[0], changes=(TOLD[0], CommandChange(now, command)))
    with pytest.raises(InvalidValueError, match="changes of command that came before"):
        envs.restore(snapshot, scenario=at_once)
    for wait, periods in ((0.005, 1), (0.03, 3)):
        change = CommandChange(now + wait, command)
        envs.restore(snapshot, scenario=replace(SCENARIOS[0], changes=(TOLD[0], change)))
        assert envs.episodes._episodes.changed[0] == change.time
        for _ in range(periods):
            assert envs.core.command[0].tolist() == [0.1, 0.0, 0.2, 0.0]
            envs.step(action)
        assert envs.core.command[0].tolist() == [0.05, -0.1, 0.1, 0.0]


def test_a_floor_that_changes_must_do_so_after_the_next_physics_step(walked):
    """A step has the floor that the one before it has left, which was before the snapshot."""
    _, snapshots = walked
    snapshot, envs = snapshots[2], vector(1)
    for wait, comes in ((0.0, False), (0.01, True)):
        (slip,) = Slip("left", 0.05, snapshot.time + wait, 0.4).forces
        asked = replace(SCENARIOS[2], pushes=(LATE, slip))
        if comes:
            envs.restore(snapshot, scenario=asked)
        else:
            with pytest.raises(InvalidValueError, match="push 1 would begin before the snapshot was taken"):
                envs.restore(snapshot, scenario=asked)


def test_a_floor_that_goes_cannot_come_later(walked):
    _, snapshots = walked
    platform = Platform(0.05, 0.5, 9.0)
    with pytest.raises(InvalidValueError) as refused:
        vector(1).restore(snapshots[2], scenario=replace(SCENARIOS[2], disturbances=(platform,)))
    assert str(refused.value) == (
        "a scenario that goes on from a snapshot must have a floor that moves if, and only if, the "
        "snapshot's own has"
    )


def test_a_new_push_must_begin_after_the_snapshot(walked):
    """Within the step that goes on, a moment of the gait is over where the elapsed time has passed it."""
    _, snapshots = walked
    envs, snapshot, scenario = vector(1), snapshots[2], SCENARIOS[2]
    rows = snapshot.rows
    step, share = rows["gait.steps"].item(), rows["gait.elapsed"].item() / rows["gait.plan"][2]
    side, other = ("left", "right") if step % 2 == 0 else ("right", "left")
    assert 0.05 < share < 0.95
    starts = {
        snapshot.time - 0.001: False, snapshot.time: True, GaitEvent(step, side, share - 0.04): False,
        GaitEvent(step, side, share + 0.04): True, GaitEvent(step + 1, other, 0.0): True,
        GaitEvent(step - 1, other, 1.0): False,
    }  # fmt: skip
    for start, comes in starts.items():
        asked = replace(scenario, pushes=(LATE, replace(LATE, start=start)))
        if comes:
            envs.restore(snapshot, scenario=asked)
            act(envs)
            assert (envs.core.pushes.start[0, 1] < envs.core.gait.time[0]) == (start == snapshot.time)
        else:
            with pytest.raises(InvalidValueError, match="push 1 would begin before"):
                envs.restore(snapshot, scenario=asked)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        (
            {"robot": "push_recovery.envs.robots.biped:ANKLE_ROLL_FIRST"},
            "taken of another robot",
        ),
        ({"control_hz": 50.0}, "another planning rate, '100 Hz', than this environment has, '50 Hz'"),
        ({"preset": "default"}, "another settings"),
        ({"sensing": "onboard"}, "another sensing, 'exact', than this environment has, 'onboard'"),
    ],
)
def test_another_kind_of_robot_is_refused(walked, kwargs, message):
    with pytest.raises(InvalidValueError, match=message):
        BipedEpisodes(1, **kwargs).restore(0, walked[1][0])


def test_another_version_is_refused(walked):
    old = replace(walked[1][0], made_for={**walked[1][0].made_for, "version": "push-recovery 0.0.1"})
    with pytest.raises(InvalidValueError, match=r"another version, 'push-recovery 0\.0\.1'"):
        vector(1).restore(old)


def test_bad_calls_are_refused_by_name(walked):
    envs, snapshots = walked
    with pytest.raises(InvalidValueError, match=r"robot must be an integer in \[0, 5\], got 6"):
        envs.restore(snapshots[0], [6])
    with pytest.raises(InvalidValueError, match="snapshot must be one or 3, one for each robot, got 2"):
        envs.restore(snapshots[:2], [0, 1, 2])
    with pytest.raises(InvalidValueError, match="snapshot must be a RobotSnapshot, got 7"):
        envs.restore(7, [0])
    with pytest.raises(InvalidValueError, match="robot 0 has no state yet"):
        vector(1).state_snapshot(0)
    pendulum = PendulumEpisodes(1)
    pendulum.begin(0, Scenario("p"))
    with pytest.raises(InvalidValueError, match="only those of bipeds can be put back"):
        pendulum.state_snapshot(0)
    with pytest.raises(InvalidValueError, match="ended or not begun"):
        gym.make("push_recovery:PushRecovery/Biped-v0").unwrapped.state_snapshot()
    ended = vector(1)
    ended.reset(options={"scenario": Scenario("short", duration=0.01)})
    act(ended)
    with pytest.raises(InvalidValueError, match="episode of robot 0 has ended"):
        ended.state_snapshot(0)
