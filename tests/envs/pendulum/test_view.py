"""The picture of the pendulum from above: each mark lies where the state says, in its colour."""

import numpy as np
import pytest
from push_recovery.envs.pendulum.env import PendulumEnv
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario

SOLES = {0: (242, 133, 31), 1: (41, 115, 204)}  # left, right
FOOTHOLD, DCM, CMP, PUSH = (47, 174, 140), (204, 26, 140), (26, 89, 230), (224, 31, 26)
FORCE = (300.0, 200.0, 0.0)
LEGEND = 70  # rows of pixels at the top: title and legend
SCALE = np.array([640 * 0.85 / 1.6, -480 * 0.805 / 1.136])  # the axes are 1.6 by 1.136 m [pixels/m]
CENTRE = np.array([640 * (0.125 + 0.425), 480 * (1 - 0.11 - 0.4025)])  # of the axes [pixels]


def env_at(
    time: float, preset: str = "default", pushes: tuple[Push, ...] = ()
) -> tuple[PendulumEnv, np.ndarray]:
    """A pendulum in place at a time, and its picture."""
    env = PendulumEnv("rgb_array", preset=preset)
    env.reset(options={"scenario": Scenario("x", pushes)})
    while env.core.state.time[0] < time - 1e-9:
        env.step(np.zeros(7, np.float32))
    return env, drawn(env)


def drawn(env: PendulumEnv) -> np.ndarray:
    picture = env.render()
    assert isinstance(picture, np.ndarray)
    return picture


def pixel(env: PendulumEnv, place: np.ndarray) -> tuple[int, int]:
    """Column and row of a place on the floor; the view is centred between CoM and sole, by leaps of 0.1 m."""
    middle = np.round((env.core.state.com[0] + env.core.state.stance[0]) / 2, 1)
    column, row = np.rint(CENTRE + SCALE * (place - middle)).astype(int).tolist()
    return column, row


def shown(picture: np.ndarray, rgb: tuple[int, int, int]) -> np.ndarray:
    """Columns and rows of the pixels of a colour below the legend."""
    rows, columns = np.nonzero(np.abs(picture[LEGEND:].astype(int) - rgb).max(axis=2) <= 6)
    return np.column_stack([columns, rows + LEGEND])


def middle_of(picture: np.ndarray, rgb: tuple[int, int, int]) -> np.ndarray:
    found = shown(picture, rgb)
    return (found.min(axis=0) + found.max(axis=0)) / 2


def through(rgb: tuple[int, int, int]) -> np.ndarray:
    """A sole's colour, which lets 0.4 of the white floor through."""
    return 0.6 * np.array(rgb) + 0.4 * 255


def test_dcm_and_cmp_are_marked_where_they_are():
    env, picture = env_at(0.15, pushes=(Push(FORCE, 0.1, start=0.0),))
    state = env.core.state
    dcm = state.com[0] + state.velocity[0] / env.robot.omega
    assert np.linalg.norm(dcm - state.com[0]) > 0.03
    np.testing.assert_allclose(middle_of(picture, DCM), pixel(env, dcm), atol=1.5)
    np.testing.assert_allclose(middle_of(picture, CMP), pixel(env, state.cmp[0]), atol=2.5)


def test_half_a_metre_of_trunk_leans_from_the_com():
    env, _ = env_at(0.05)
    env.core.state.angle[0] = 0.4, -0.6
    com, trunk = env.core.state.com[0], shown(drawn(env), (64, 64, 64))
    for end in (com, com + [0.5 * np.sin(0.4), 0.5 * np.sin(-0.6)]):
        assert np.linalg.norm(trunk - pixel(env, end), axis=1).min() < 4.0
    beyond = pixel(env, com - [0.5 * np.sin(0.4), 0.5 * np.sin(-0.6)])
    assert np.linalg.norm(trunk - beyond, axis=1).min() > 20.0


def test_an_arrow_of_a_metre_for_1000_newton_ends_at_the_com_while_the_push_acts():
    push = Push(FORCE, 0.1, start=0.1)
    assert len(shown(env_at(0.05, pushes=(push,))[1], PUSH)) == 0
    env, picture = env_at(0.12, pushes=(push,))
    com, arrow = env.core.state.com[0], shown(picture, PUSH)
    tail = np.array(pixel(env, com - np.array(FORCE[:2]) / 1000))
    assert np.linalg.norm(arrow - tail, axis=1).min() < 5.0
    assert arrow[:, 0].min() >= tail[0] - 4
    assert arrow[:, 1].max() <= tail[1] + 4
    assert arrow[:, 0].max() <= pixel(env, com)[0]
    assert len(shown(env_at(0.25, pushes=(push,))[1], PUSH)) == 0


@pytest.mark.parametrize("time", [0.05, 0.6])
def test_the_stance_sole_has_its_foots_colour_and_the_planned_one_its_own(time):
    env, picture = env_at(time)
    state, (length, width) = env.core.state, (env.robot.foot_length, env.robot.foot_width)
    side, stance, plan = int(state.side[0]), state.stance[0], state.plan[0]
    planned = stance + [plan[0], (-1.0 if side == 0 else 1.0) * plan[1]]
    for centre, rgb in ((stance, SOLES[side]), (planned, FOOTHOLD)):
        for aside, expected in ((0.4, through(rgb)), (0.7, 255.0)):  # on the sole, and beside it
            line = [pixel(env, centre + [x * length, aside * width]) for x in np.linspace(-0.45, 0.45, 41)]
            found = np.median([picture[row, column] for column, row in line], axis=0)  # not of the grid
            np.testing.assert_allclose(found, expected, atol=2.0)
    assert len(shown(picture, tuple(through(SOLES[1 - side]).astype(int)))) == 0


def test_in_double_support_the_sole_that_is_about_to_lift_is_drawn_too():
    env, _ = env_at(0.0, "double-support")
    while int(env.core.state.steps[0]) == 0:
        env.step(np.zeros(7, np.float32))
    picture, state = drawn(env), env.core.state
    side = int(state.side[0])
    column, row = pixel(env, state.lift[0] + [0.07, -0.03])
    over = 0.6 * np.array(SOLES[1 - side]) + 0.4 * through(FOOTHOLD)  # in place it will land where it was
    np.testing.assert_allclose(picture[row, column], over, atol=2.0)
