"""Peaks of the recoveries from hard pushes: joint speeds and torques, power, floor force, lean, penetration.

python benchmarks/peaks.py [--suite hard] [--sample 128] [--profile exact] [--policy two-stage] [--json]

Every control step of the pushes that are recovered, from the push on. A joint of a leg counts as in a
collision for WINDOW after its foot has met the floor: while the sole settles, or bounces. All other
over-speed is the motors' own business, but for a sole that stands on an edge and falls flat later: the blow
of its other edge turns the ankle, too. So speeds stand there twice: out of WINDOW after the foot has met the
floor, and out of WINDOW after any corner of its sole has. Walking, unpushed at 0.5 m/s, stands beside it.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from push_recovery.controllers.model.robot import GRAVITY
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import FOOT_BODY, NU, PELVIS, TRUNK
from push_recovery.envs.biped.core import BipedCore
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.model_errors import CONTROL_STEP
from push_recovery.envs.scenario.scenario import Command, Profile, Scenario
from push_recovery.eval.rollout.episodes import rollout_batch
from push_recovery.eval.score.sensitivity import VARIATIONS, sample_of
from push_recovery.eval.score.suites import get_suite

WINDOW = 0.03  # three time constants of the contacts [s]
KINDS = ("own", "between", "collision", "torque")  # columns of the table
JOINTS = (
    "waist_pitch",
    "waist_roll",
    "hip_yaw",
    "hip_roll",
    "hip_pitch",
    "knee",
    "ankle_pitch",
    "ankle_roll",
)
UNITS = {"power": "W/kg", "floor": "body weights", "sunk": "mm", "lean": "degrees"}  # of the whole robot
LEG_OF = np.array([-1, -1] + 6 * [0] + 6 * [1])  # of every motor; -1: none
Array = NDArray[np.float64]


@dataclass
class Peaks:
    """Largest values of n robots since their pushes began."""

    own: Array  # (n, 14) speed over that without load, out of collisions
    between: Array  # (n, 14) the same, no corner of the sole having met the floor just now
    collision: Array  # (n, 14) in collisions
    torque: Array  # (n, 14) over the largest
    power: Array  # (n,) that all motors give together [W/kg]
    floor: Array  # (n,) force of the floor [body weights]
    sunk: Array  # (n,) depth of a corner of a sole in the floor [mm]
    lean: Array  # (n,) of pelvis or trunk from upright [degrees]

    def rows(self) -> dict[str, list[float]]:
        """Median, 95th percentile and largest of each, both sides of a joint as one."""
        found = {}
        for name in KINDS:
            values = getattr(self, name)
            for joint, label in enumerate(JOINTS):
                columns = [joint] if joint < 2 else [joint, joint + 6]
                found[f"{label} {name}"] = _spread(values[:, columns].max(axis=1))
        return {**found, **{name: _spread(getattr(self, name)) for name in UNITS}}


def corner_heights(core: BipedCore) -> Array:
    """Heights of the corners of the soles over the floor, (n, 2, 4) [m]."""
    true, (x, y) = core.judged, core.body.half_sole
    corners = np.array([(a, b, 0.0) for a in (x, -x) for b in (y, -y)])
    heights = []
    for leg, body in enumerate(FOOT_BODY):
        upwards = true.xmat[:, body, 6:]  # third row of the foot's axes
        heights.append(true.xpos[:, body, 2:] + upwards @ (corners + true.soles[leg]).T)
    return np.stack(heights, axis=1)


def _spread(values: Array) -> list[float]:
    return [float(np.quantile(values, q)) for q in (0.5, 0.95, 1.0)]


class Watch:
    """Looks at a core after every control step, all robots beginning together."""

    def __init__(self, episodes: BipedEpisodes, pushed: bool):
        self.core, self.pushed = episodes.core, pushed
        n, (self.top, self.free) = episodes.core.n, episodes.core.body.motors
        self.weight = episodes.robot.mass * GRAVITY
        self.since = np.full((n, 2), np.inf)  # a foot has met the floor [s]
        self.corner_since = self.since.copy()  # a corner of its sole has
        self.loaded, self.down = np.ones((n, 2), bool), np.ones((n, 2, 4), bool)
        self.peaks = Peaks(*np.zeros((4, n, NU)), *np.zeros((4, n)))
        self.core.after_physics_step = self

    def __call__(self) -> None:
        """Note the control step just made."""
        true, core, peaks = self.core.judged, self.core, self.peaks
        load, heights = true.load > 0.0, corner_heights(core)
        down = heights < 0.0
        meets = (down & ~self.down).any(axis=2)
        self.since = np.where(load & ~self.loaded, 0.0, self.since + CONTROL_STEP)
        self.corner_since = np.where(meets, 0.0, self.corner_since + CONTROL_STEP)
        self.loaded, self.down = load, down
        begun = core.gait.time >= core.pushes.start.min(axis=1) if self.pushed else True
        counts = begun & (core.gait.failure == 0)
        speed, torque = true.qvel[:, 6:20], np.clip(true.ctrl, -self.top, self.top)
        met = (self.since <= WINDOW)[:, LEG_OF] & (LEG_OF >= 0)
        struck = met | (self.corner_since <= WINDOW)[:, LEG_OF] & (LEG_OF >= 0)
        power = np.maximum(torque * speed, 0.0).sum(axis=1) / self.weight * GRAVITY
        force = np.linalg.norm(core.senses.last.judged_contacts.force[:, :3], axis=1) / self.weight
        sunk = -1e3 * np.minimum(heights, 0.0).min(axis=(1, 2))
        upright = true.xmat[:, [PELVIS, TRUNK], 8].min(axis=1)
        lean = np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))
        over = np.abs(speed) / self.free
        for most, now in (
            (peaks.own, np.where(met, 0.0, over)), (peaks.between, np.where(struck, 0.0, over)),
            (peaks.collision, np.where(met, over, 0.0)),
            (peaks.torque, np.abs(torque) / self.top), (peaks.power, power), (peaks.floor, force),
            (peaks.sunk, sunk), (peaks.lean, lean),
        ):  # fmt: skip
            most[counts] = np.maximum(most, now)[counts]


def measured(scenarios: list[Scenario], policy: str) -> tuple[Peaks, int]:
    """Peaks of the scenarios that are recovered, and how many there are."""
    episodes = BipedEpisodes(len(scenarios))
    watch = Watch(episodes, bool(scenarios[0].pushes))
    planner = make_policy(policy, episodes.robot, episodes.limits, episodes.preset)
    outcomes = {o.scenario_id: o for o in rollout_batch(episodes, planner, scenarios, policy)}
    good = np.array([outcomes[s.id].recovered or not s.pushes for s in scenarios])
    return Peaks(*(values[good] for values in vars(watch.peaks).values())), int(good.sum())


def walked(profile: Profile, policy: str) -> Peaks:
    """Peaks of walking at 0.5 m/s without a push."""
    walk = Scenario("walk", command=Command(0.5), duration=10.0)
    return measured([profile.applied(walk)], policy)[0]


def print_table(walk: dict[str, list[float]], rows: dict[str, list[float]]) -> None:
    """One row a joint, then what is of the whole robot."""
    print("| joint | speed / no load, out of collisions | of corners | in collisions | torque / largest |")
    print("|---|---|---|---|---|")
    for label in JOINTS:
        cells = (
            f"{walk[f'{label} {kind}'][2]:.2f}; " + ", ".join(f"{x:.2f}" for x in rows[f"{label} {kind}"])
            for kind in KINDS
        )
        print(f"| {label} | {' | '.join(cells)} |")
    for label, unit in UNITS.items():
        print(f"{label} [{unit}]: {walk[label][2]:.3g}; {', '.join(f'{x:.3g}' for x in rows[label])}")


def main() -> None:
    """Print walking; median, 95th percentile and largest of the recoveries."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--suite", default="hard", help="name or file (default: %(default)s)")
    parser.add_argument("--sample", type=int, default=128, help="pushes of it (default: %(default)s)")
    parser.add_argument(
        "--profile", default="exact", choices=VARIATIONS, help="or variation of `sensitivity`"
    )
    parser.add_argument("--policy", default="two-stage", help="name (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    options = parser.parse_args()
    profile = VARIATIONS[options.profile]
    pushes = sample_of(get_suite(options.suite), options.sample).scenarios
    peaks, recovered = measured([profile.applied(push) for push in pushes], options.policy)
    walk, rows = walked(profile, options.policy).rows(), peaks.rows()
    if options.json:
        json.dump({"recovered": recovered, "pushes": len(pushes), "walk": walk, "pushed": rows}, sys.stdout)
        return
    print(f"{options.profile}, {options.policy}: {recovered} of {len(pushes)} of {options.suite} recovered.")
    print("Each: walking; median, 95 %, largest of the recoveries.\n")
    print_table(walk, rows)


if __name__ == "__main__":
    main()
