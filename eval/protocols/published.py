"""What others have published under their protocols, and how their robots differ from ours."""

from __future__ import annotations

import math
from typing import NamedTuple

from ...controllers.model.robot import GRAVITY, RobotModel
from ...controllers.model.similarity import Similarity
from .follower import FASTEST_X, FASTEST_Y
from .kick import FORCES, jump_of
from .tour import CEILING, PUNCH_DURATION, force_share

# RecoverFormer (Unitree G1), share of episodes without a fall [%] by level, paper's Table I of commit 70eabd2
KICK_ROWS: dict[str, dict[int, float]] = {
    "RecoverFormer, open floor, 200 each (published)": {
        50: 100.0, 100: 100.0, 150: 85.0, 200: 79.0, 250: 68.0, 300: 68.0,
    },
    "RecoverFormer, between walls, 100 each (published)": {
        100: 100.0, 150: 100.0, 200: 100.0, 250: 100.0, 300: 100.0,
    },
}  # fmt: skip
KICK_NOTE = (
    "The published rows are of a Unitree G1 (29 joints, arms, 1.27 m, 35 kg, CoM at about 0.69 m) under a "
    "learned policy at 50 Hz that stands still; its program multiplies the friction by a number from 0.5 to "
    "1.2 at every reset, again and again, and its episodes are not seeded. "
)


def kick_note(robot: RobotModel) -> str:
    """What differs between their robot and ours."""
    jump = jump_of(FORCES[-1])
    share = jump / math.sqrt(GRAVITY * robot.com_height)
    return (
        f"{KICK_NOTE}This robot weighs {robot.mass:.1f} kg and has its CoM at {robot.com_height:.2f} m; its "
        "arms, if it has any, are held. It steps in place, knows its model and its true state, and stands on "
        f"friction 0.9. Jump over sqrt(g h): {jump:.3f} m/s is 0.33 on their G1 and {share:.2f} here.\n"
    )


class TourRow(NamedTuple):
    """A row of the benchmark's table; MuJoCo, then PhysX."""

    survival: tuple[float, float]  # mean [s] of 90
    completed: tuple[int, int]  # [%]
    runs: int
    position: tuple[int, int]  # error at the ends of segments [cm]
    heading: tuple[int, int]  # [degrees]


# README of commit 6d331a85: the rows of 5120 runs, and the best three of 512
TOUR_ROWS: dict[str, TourRow] = {
    "gr00t_wbc h066_p012": TourRow((84.9, 82.2), (80, 69), 5120, (16, 49), (7, 8)),
    "gr00t_wbc h066_p000": TourRow((84.7, 81.8), (79, 67), 5120, (17, 57), (8, 9)),
    "decoupled_wbc h066_p012": TourRow((83.9, 80.9), (75, 66), 5120, (10, 20), (7, 6)),
    "decoupled_wbc h066_p000": TourRow((83.9, 81.3), (74, 67), 5120, (10, 22), (7, 5)),
    "gr00t_wbc h070_p000": TourRow((83.3, 82.9), (73, 71), 5120, (14, 21), (5, 6)),
    "decoupled_wbc h070_p000": TourRow((83.1, 80.2), (72, 63), 5120, (10, 15), (7, 6)),
    "decoupled_wbc h074_p000": TourRow((82.3, 80.1), (69, 62), 5120, (11, 14), (8, 7)),
    "gr00t_wbc h074_p000": TourRow((80.1, 80.0), (63, 61), 5120, (13, 16), (5, 6)),
    "homie": TourRow((78.3, 77.4), (55, 52), 5120, (17, 19), (32, 37)),
    "amo": TourRow((75.7, 77.6), (53, 57), 5120, (24, 39), (18, 17)),
    "wbc_agile_velocity": TourRow((75.1, 79.3), (49, 60), 5120, (22, 23), (7, 6)),
    "wbc_agile": TourRow((70.9, 64.3), (33, 18), 512, (23, 41), (8, 11)),
    "sonic": TourRow((68.5, 52.9), (36, 11), 512, (30, 44), (9, 11)),
    "mimic_lite": TourRow((48.1, 59.5), (9, 21), 512, (76, 89), (12, 12)),
}
TOUR_NOTE = (
    "The published rows are of a Unitree G1 (35.1 kg, 29 joints) whose arms the harness moves at random, in "
    "MuJoCo Warp at 2 ms; a fall there is a pelvis below 0.20 m. Its 26 other policies complete 8 % at most. "
    "A punch of a leg acts at the same joint here, on thigh, shank or foot, one of the waist on the trunk at "
    "the waist, one of an arm on the same link of it; a robot without arms gets those on the trunk, 0.24 m "
    "over the waist and 0.10 m aside. Arms are held; no harness moves them. The robot begins in a nominal "
    "step without the three seconds in a crane, steps all the time, turns at 0.6 rad/s at most, knows its "
    "model and true state, and falls by this project's criterion, which is the stricter one. Errors stand "
    "at the ends of the segments that were begun; energy and vibration are not counted. "
)


def tour_note(robot: RobotModel) -> str:
    """What differs between their robot and ours."""
    share, velocity = force_share(robot), Similarity.of(robot).velocity
    forces = f"up to {CEILING * share:.0f} N for {PUNCH_DURATION} s"
    meets = (
        f"the published forces, {forces}" if share == 1.0 else f"forces scaled by mass, {forces}, 1.14 N s/kg"
    )
    return (
        f"{TOUR_NOTE}This robot weighs {robot.mass:.1f} kg and meets {meets}; it walks forward at up to "
        f"{FASTEST_X * velocity:.2f} and aside at {FASTEST_Y * velocity:.2f} m/s.\n"
    )
