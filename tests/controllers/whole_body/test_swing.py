"""Turning: its references, the walk on a circle, how it is judged."""

import json

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.observation import COMMAND
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body import swing
from push_recovery.controllers.whole_body.kinematics import FOOT_BODY, PELVIS
from push_recovery.controllers.whole_body.swing import SIZE, exchange_soles, given_yaw, swing_update, yaw_back
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode.recovery import GaitMonitor, record_touchdown
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import IN_PLACE, Command, CommandChange, Scenario

DT, APEX, DESCENT = 0.002, 0.06, 0.3


def fly(duration=lambda t: 0.5, target=lambda t: (0.3, 0.2), end=0.5, dt=DT):
    state = np.zeros(9)
    state[0:2] = -0.1, -0.2
    trace = [state.copy()]
    for k in range(round(end / dt)):
        t = k * dt
        swing_update(state, *target(t), t, duration(t), dt, APEX, DESCENT)
        trace.append(state.copy())
    return np.array(trace)


def test_arrives_at_the_target_at_rest_and_at_the_floor_on_time():
    end = fly()[-1]
    assert end[0:2] == pytest.approx([0.3, 0.2], abs=1e-3)
    assert end[3:5] == pytest.approx([0.0, 0.0], abs=0.01)
    assert end[2] == pytest.approx(0.0, abs=1e-3)
    assert end[5] == pytest.approx(-0.1, abs=0.02)


def test_regenerating_with_the_same_target_follows_one_curve():
    fine, coarse = fly(dt=0.001)[::10], fly(dt=0.01)
    horizontal = [0, 1, 3, 4, 6, 7]
    assert fine[:44, horizontal] == pytest.approx(coarse[:44, horizontal], abs=1e-6)
    assert fine[:19] == pytest.approx(coarse[:19], abs=1e-6)  # upwards, until close to the apex


def moving(t):
    return (0.3, 0.2) if t < 0.2 else (0.45, 0.1)


@pytest.mark.parametrize("duration", [lambda t: 0.5, lambda t: 0.5 if t < 0.25 else 0.42])
def test_position_velocity_and_acceleration_stay_continuous(duration):
    """Steps of each derivative shrink with dt: what remains is bounded by the next derivative times dt."""
    trace = fly(duration, moving, 0.55)
    for level in range(2):
        values, rates = trace[:, 3 * level : 3 * level + 3], trace[:, 3 * level + 3 : 3 * level + 6]
        mean_rate = 0.5 * (rates[1:] + rates[:-1])
        scale = np.abs(rates).max()
        assert np.abs(np.diff(values, axis=0) - mean_rate * DT).max() < 0.05 * scale * DT + 1e-6
    steps = [np.abs(np.diff(fly(duration, moving, 0.55, dt)[:, 6:], axis=0)).max() for dt in (0.002, 0.0005)]
    assert steps[1] < 0.5 * steps[0]


def test_late_foot_descends_at_constant_speed():
    trace = fly(lambda t: 0.5, end=0.7)
    assert trace[-1, 5] == pytest.approx(-DESCENT, rel=1e-3)
    assert trace[-1, 8] == pytest.approx(0.0, abs=0.05)


def test_a_foot_with_too_little_time_comes_down_at_two_metres_a_second_and_is_late():
    """From 8 cm, 20 ms before T: a quintic would peak at 1.875 x 0.08 / 0.02 = 7.5 m/s."""
    state, dt = np.zeros(9), 0.001
    state[2], heights, speeds = 0.08, [0.08], [0.0]
    for i in range(200):
        swing_update(state, 0.0, 0.0, 0.38 + i * dt, 0.4, dt, 0.06, 0.3)
        heights.append(state[2])
        speeds.append(state[5])
    assert -2.0 < min(speeds) < -0.5
    assert heights[20] > 0.04  # it is late
    # the height is the integral of the speed all the way, also where the foot is late
    np.testing.assert_allclose(np.diff(heights), 0.5 * dt * (np.array(speeds[1:]) + speeds[:-1]), atol=2e-6)
    assert speeds[-1] == pytest.approx(-0.3, abs=1e-6)


@pytest.mark.parametrize("duration", [0.4, 0.6])
def test_the_foot_is_highest_at_45_percent_of_the_step(duration):
    heights = fly(duration=lambda t: duration, end=duration)[:, 2]
    assert heights.argmax() * DT == pytest.approx(0.45 * duration, abs=1.5 * DT)
    assert heights.max() == pytest.approx(APEX, rel=0.01)
    assert heights.min() > -1e-3


POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
RATE, DURATION, FINAL, DT_TURNING = 0.4, 0.5, 0.055, 0.002


def follow(yaw: np.ndarray, rate: float, begin: float, end: float, given: float = 0.0) -> None:
    for i in range(round(begin / DT_TURNING), round(end / DT_TURNING)):
        swing.turn_references(yaw, rate, DURATION, DURATION - i * DT_TURNING, FINAL, given, DT_TURNING)


def walk(command: Command, seconds: float, changes: tuple[CommandChange, ...] = ()):
    """Episodes of one biped after a walk, and by period: CoM (2), heading, observation (36)."""
    episodes = BipedEpisodes(1)
    episodes.begin(0, Scenario("a", (), command, duration=100.0, changes=changes))
    com, heading, seen = [], [], []
    for _ in range(round(100 * seconds)):
        episodes.step(POLICY.predict(episodes.core.observation)[0])
        com.append(episodes.motion().com[0].copy())
        heading.append(episodes.motion().heading.item(0))
        seen.append(episodes.core.observation[0].copy())
    return episodes, np.array(com), np.array(heading), np.array(seen)


def yaw_of(episodes: BipedEpisodes, body: int) -> float:
    xmat = episodes.core.physics.xmat[0, body]
    return float(np.arctan2(xmat[3], xmat[0]))


def test_the_sole_lands_at_rest_and_the_pelvis_half_way_at_the_commanded_rate():
    yaw = np.zeros(SIZE)
    for _ in range(4):
        follow(yaw, RATE, 0.0, DURATION)
        assert yaw[0] == pytest.approx(RATE * DURATION, abs=1e-5)
        assert yaw[1] == pytest.approx(0.0, abs=1e-3)
        assert yaw[3] == pytest.approx(0.5 * RATE * DURATION, abs=1e-4)
        assert yaw[4] == pytest.approx(RATE, abs=1e-2)
        exchange_soles(yaw)


def test_a_sole_lands_turned_for_a_pelvis_that_is_twisted():
    """What is given comes on top of the command, and the pelvis ends half-way."""
    yaw = np.zeros(SIZE)
    follow(yaw, RATE, 0.0, DURATION, given=-0.5)
    assert yaw[0] == pytest.approx(RATE * DURATION - 0.5, abs=1e-5)
    assert yaw[3] == pytest.approx(0.5 * (RATE * DURATION - 0.5), abs=1e-4)


@pytest.mark.parametrize(
    ("twist", "most", "given"),
    [(0.3, 0.1, 0.2), (-0.3, 0.1, -0.2), (0.1, 0.1, 0.0), (-0.05, 0.1, 0.0), (2.0, 0.1, 0.8),
     (-2.0, 0.1, -0.8), (3.1, np.pi, 0.0)],
)  # fmt: skip
def test_what_is_given_by_hand(twist, most, given):
    assert given_yaw(twist, most) == pytest.approx(given, abs=1e-15)


@pytest.mark.parametrize(
    ("astray", "most", "back"),
    [(0.2, 0.3, -0.2), (-0.2, 0.3, 0.2), (0.5, 0.3, -0.3), (-0.5, 0.3, 0.3), (0.5, 0.0, 0.0)],
)
def test_yaw_that_turns_back_by_hand(astray, most, back):
    assert yaw_back(astray, most) == pytest.approx(back, abs=1e-15)


def twist(side, start):
    """60 N m about the vertical for 0.1 s, by a pair of forces."""
    return tuple(
        Push((sign * 600.0, 0.0, 0.0), 0.1, start, offset=(0.0, -0.05 * sign * side, 0.0))
        for sign in (1.0, -1.0)
    )


def twisted(gait, preset, pushes, command=IN_PLACE, changes=()):
    """Headings of the biped [rad] in 5 s, by period."""
    about = {"format": "push-recovery preset", "format_version": 1, "base": "biped", "biped": {"gait": gait}}
    preset.write_text(json.dumps(about))
    episodes, headings = BipedEpisodes(1, preset=str(preset)), []
    episodes.begin(0, Scenario("a", pushes, duration=100.0, command=command, changes=changes))
    for _ in range(500):
        episodes.step(POLICY.predict(episodes.core.observation)[0])
        headings.append(episodes.motion().heading.item(0))
    assert episodes.failure()[0] == 0
    assert yaw_of(episodes, PELVIS) == pytest.approx(headings[-1], abs=0.02)
    return np.array(headings)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_robot_that_gives_way_turns_with_a_twist_instead_of_against_it(side, tmp_path):
    preset, pushes = tmp_path / "preset.json", twist(side, 1.0)
    assert not twisted({"twist_max": np.pi}, preset, pushes).any()
    assert side * twisted({"twist_max": 0.05}, preset, pushes)[-1] > 0.05


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_robot_that_gave_way_turns_back_by_no_more_than_a_bound_in_a_step(side, tmp_path):
    gait = {"twist_max": 0.05, "turn_back": 0.1}
    headings = side * twisted(gait, tmp_path / "preset.json", twist(side, 1.0))
    assert headings.max() > 0.2
    assert headings[-1] == pytest.approx(0.0, abs=1e-3)
    assert np.diff(headings).min() == pytest.approx(-0.1, abs=1e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_commands_a_turn_steers_and_the_heading_at_its_end_is_kept(side, tmp_path):
    """The twist at 1 s is followed by turning until 2.5 s; another at 2.6 s is turned back from."""
    preset, at_end = tmp_path / "preset.json", []
    for gait in ({"twist_max": 0.05}, {"twist_max": 0.05, "turn_back": 0.1}):
        pushes = twist(side, 1.0)
        turning = Command(turn=0.3), (CommandChange(2.5, Command()),)
        without = twisted(gait, preset, pushes, *turning)
        at_end.append(without[-1])
        twice = twisted(gait, preset, (*pushes, *twist(side, 2.6)), *turning)
        assert (abs(twice[-1] - without[-1]) < 1e-3) == ("turn_back" in gait)
    assert at_end[0] == pytest.approx(at_end[1], abs=1e-3)
    assert abs(at_end[0] - 0.3 * 2.5) > 0.05


def test_no_reference_jumps_where_the_feet_change_roles():
    yaw, heading = np.zeros(SIZE), 0.3
    follow(yaw, RATE, 0.0, 0.7 * DURATION)  # lands early
    sole, pelvis = heading + yaw[0], heading + yaw[3:6]
    turned = exchange_soles(yaw)
    assert heading + turned == pytest.approx(sole)  # new stance sole
    assert heading + turned + yaw[0] == pytest.approx(heading)  # new swing sole
    np.testing.assert_allclose(heading + turned + yaw[3], pelvis[0])
    np.testing.assert_array_equal(heading + yaw[4:6], pelvis[1:])


def test_the_yaw_at_landing_is_final_shortly_before():
    yaw = np.zeros(SIZE)
    follow(yaw, RATE, 0.0, DURATION - FINAL + DT_TURNING)
    follow(yaw, -RATE, DURATION - FINAL + DT_TURNING, DURATION)
    assert yaw[0] == pytest.approx(RATE * DURATION, abs=1e-5)


@pytest.mark.parametrize("rate", [0.6, -0.3, 0.0])
def test_a_planner_of_straight_steps_told_the_turned_command_turns_at_the_commanded_speed(rate):
    """It lands with b = L / (lambda - 1) in its stance frame; the next one is turned by theta.

    In the periodic gait the DCM starts at exp(-i theta) b, so the foot goes to u = lambda exp(-i theta) b
    - b: v P towards the mean of the headings before and after, theta / 2.
    """
    velocity, period, omega = 0.4 + 0.1j, 0.37, BIPED.omega
    theta, growth = rate * period, np.exp(omega * period)
    told = complex(*swing.turned_command(velocity.real, velocity.imag, rate, period, omega))
    offset = told * period / (growth - 1.0)
    step = growth * np.exp(-1j * theta) * offset - offset
    assert step == pytest.approx(velocity * period * np.exp(0.5j * theta), abs=1e-12)


@pytest.mark.parametrize(
    ("command", "off"),
    [
        (Command(0.3, turn=0.3), 0.03),
        (Command(0.5, turn=-0.6), 0.06),
        (Command(0.5, 0.2, turn=0.6), 0.06),
        (Command(-0.25, turn=0.6), 0.04),
    ],
)
def test_it_keeps_the_commanded_speed_while_it_turns(command, off):
    episodes, *_ = walk(command, 8.0)
    assert episodes.monitor.state.speed_error[0] < off
    assert episodes.monitor.recovered_at(0) is not None


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_walks_on_a_circle(side):
    episodes, com, heading, seen = walk(Command(0.3, turn=side * 0.3), 20.0)
    assert episodes.failure()[0] == 0
    assert heading[-1] == pytest.approx(side * 6.0, rel=0.05)
    x, y = com[200:].T
    A = np.stack([2.0 * x, 2.0 * y, np.ones_like(x)], axis=1)
    a, b, c = np.linalg.lstsq(A, x * x + y * y, rcond=None)[0]  # circle through the points
    assert np.sqrt(c + a * a + b * b) == pytest.approx(0.3 / 0.3, rel=0.1)
    np.testing.assert_allclose(np.hypot(*seen[:, COMMAND].T), 0.3, rtol=0.01)
    np.testing.assert_allclose(seen[200:, COMMAND.start], seen[200, COMMAND.start], atol=0.01)  # in its frame
    assert episodes.monitor.recovered_at(0) is not None


def test_the_stance_sole_points_along_the_heading_and_the_pelvis_stays_between_the_soles():
    episodes = BipedEpisodes(1)
    episodes.begin(0, Scenario("a", (), Command(turn=0.4), duration=100.0))
    gait = episodes.core.gait
    for _ in range(400):
        episodes.step(POLICY.predict(episodes.core.observation)[0])
        heading, stance = gait.heading.item(0), gait.stance.item(0)
        assert yaw_of(episodes, FOOT_BODY[stance]) == pytest.approx(heading, abs=0.03)
        assert abs(yaw_of(episodes, PELVIS) - heading) < 0.5 * 0.4 * gait.plan[0, 2] + 0.04


def test_turning_ends_with_its_command():
    stop = CommandChange(4.0, Command())
    episodes, _, heading, _ = walk(Command(0.2, turn=-0.5), 7.0, (stop,))
    assert episodes.failure()[0] == 0
    assert heading[460] == pytest.approx(-0.5 * 4.0, abs=0.25)
    assert heading[-1] == pytest.approx(heading[460], abs=1e-12)
    assert yaw_of(episodes, PELVIS) == pytest.approx(heading[-1], abs=0.02)


def test_nothing_turns_without_a_command():
    episodes, _, heading, _ = walk(Command(0.3), 2.0)
    assert not heading.any()
    assert not episodes.core.gait.yaw.any()


TURNING = Command(0.2, turn=0.5)


def pushed(pushes: list[Push], command: Command = TURNING) -> BipedEpisodes:
    """Bipeds side by side, each after 4 s with a push of its own."""
    episodes = BipedEpisodes(len(pushes))
    for _ in range(2):  # what a push has turned is forgotten at reset
        for k, push in enumerate(pushes):
            episodes.begin(k, Scenario(f"{k}", (push,), command, duration=100.0))
        for _ in range(400):
            episodes.step(POLICY.predict(episodes.core.observation)[0])
    return episodes


@pytest.mark.parametrize("start", [2.345, GaitEvent(5, "left", 0.4)])
def test_a_push_in_the_heading_frame_comes_from_the_same_side_of_a_robot_that_has_turned(start):
    probe = pushed([polar_push(0.0, 0.0, 0.1, start)])
    begun = probe.core.pushes.start.item(0, 0)
    _, _, heading, _ = walk(TURNING, begun)
    turned = heading[-1]  # no touchdown comes between the period's end and the push
    assert turned > 0.5
    along = polar_push(300.0, 0.8, 0.1, start, "trunk", "heading")
    world = [polar_push(300.0, 0.8 + angle, 0.1, start, "trunk") for angle in (turned, turned + 0.5)]
    core = pushed([along, *world]).core
    assert core.pushes.start[0, 0] == begun
    np.testing.assert_allclose(core.pushes.delivered[0, 0], world[0].impulse, atol=1e-9)
    np.testing.assert_allclose(core.physics.qpos[0], core.physics.qpos[1], atol=1e-6)
    assert np.abs(core.physics.qpos[0] - core.physics.qpos[2]).max() > 0.01


def test_a_robot_that_has_not_turned_feels_the_same_push_in_both_frames():
    frames = [polar_push(300.0, 0.8, 0.1, 2.0, frame="heading"), polar_push(300.0, 0.8, 0.1, 2.0)]
    core = pushed(frames, Command(0.2)).core
    np.testing.assert_array_equal(core.physics.qpos[0], core.physics.qpos[1])
    pendulums = PendulumEpisodes(2)
    for k, push in enumerate(frames):
        pendulums.begin(k, Scenario(f"{k}", (push,)))
    for _ in range(250):
        pendulums.step(POLICY.predict(pendulums.core.observation)[0])
    np.testing.assert_array_equal(pendulums.core.observation[0], pendulums.core.observation[1])


def test_speed_is_judged_in_the_heading_frame():
    """Steps straight along headings that turn by d: the mean over two of them is v cos(d / 2) forward."""
    monitor, com, turned, v, span = GaitMonitor(1), np.zeros(2), 0.3, 0.4, 0.5
    command = np.array([v, 0.0, turned / span])
    for i in range(5):
        heading = 2.0 + turned * i
        record_touchdown(monitor.state, 0, 0.0, com.copy(), heading, span * i, 0.0, command)
        com += v * span * np.array([np.cos(heading), np.sin(heading)])
    assert monitor.state.speed_error[0] == pytest.approx(v * (1.0 - np.cos(turned / 2)), abs=1e-12)


def test_a_pendulum_refuses_to_turn():
    scenario = Scenario("bend", changes=(CommandChange(1.0, Command(turn=-0.2)),))
    message = "Pendulum-v0 does not turn: Command.turn must be 0 rad/s, got -0.2 in scenario 'bend'"
    with pytest.raises(InvalidValueError, match=message):
        PendulumEpisodes(1).begin(0, scenario)


@pytest.mark.parametrize(
    ("rise", "share"), [(0.0, 0.45), (0.05, 0.4), (-0.05, 0.5), (0.3, 0.35), (-0.3, 0.55)]
)
def test_up_a_step_a_foot_is_highest_sooner_and_down_a_step_later(rise, share):
    assert swing.apex_phase_of(rise) == pytest.approx(share)
