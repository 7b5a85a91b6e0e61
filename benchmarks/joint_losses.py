"""What joints that lose torque do to an unpushed walk, and what robots find of them as they swing.

python benchmarks/joint_losses.py [--speed 0.3] [--robots 4] [--seconds 10]

Each robot walks twice: as it is, and forgetting at once what it has found (`blind`). Lateness of the
touchdowns and speed are means from 3 s on; frictions and rotors are means of both legs at the end.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from push_recovery.controllers.estimation.self_model import FRICTION, ROTOR
from push_recovery.controllers.model.gait_box import DURATION
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.model_errors import CONTROL_STEP, ModelErrors
from push_recovery.envs.scenario.scenario import EXACT, HARDWARE, Command, Profile, Scenario
from push_recovery.eval.rollout.episodes import rollout_batch

BEGIN = 3.0  # [s]
JOINTS = ("hip yaw", "hip roll", "hip pitch", "knee", "ankle pitch", "ankle roll")
ROBOTS = {
    "exact": EXACT,
    "friction of 1 N m": Profile("friction", ModelErrors(joint_friction=1.0)),
    "rotors heavier by 0.03 kg m^2": Profile("rotors", ModelErrors(armature=0.03)),
    "delay of 4 ms": Profile("delay", ModelErrors(delay=0.004)),
    "own sensors": Profile("sensors", sensing=HARDWARE.sensing),
    "hardware": HARDWARE,
}


@dataclass(frozen=True)
class Walk:
    """What came of one kind of robot."""

    late: float  # touchdown after the planned one [s]
    speed: float  # forwards [m/s]
    found: np.ndarray  # (2, 6) friction [N m] and rotor [kg m^2]


def walk(profile: Profile, speed: float, robots: int, seconds: float, blind: bool) -> Walk:
    """Let robots walk unpushed at a command [m/s] for so long [s]."""
    episodes = BipedEpisodes(robots, variant="two-stage")
    core, late = episodes.core, []
    before, steps, due, began = (np.zeros(robots) for _ in range(4))

    def look() -> None:
        gait = core.gait
        if blind:
            core.known.joints[:] = 0.0
        landed = gait.steps > steps
        late.extend((before - due)[landed & (gait.time > BEGIN)])
        began[gait.time <= BEGIN] = core.judged.qpos[gait.time <= BEGIN, 0]
        before[:], steps[:], due[:] = gait.elapsed, gait.steps, gait.plan[:, DURATION]

    core.after_physics_step = look
    walks = [
        Scenario(f"walk-{k}", command=Command(speed), duration=seconds, noise_seed=k) for k in range(robots)
    ]
    policy = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
    outcomes = list(rollout_batch(episodes, policy, [profile.applied(w) for w in walks], "two-stage"))
    if not all(outcome.survived for outcome in outcomes):
        raise SystemExit(f"error: a robot of {profile.name} fell")
    legs = core.known.joints[:, 2:].reshape(2 * robots, 6, -1).mean(axis=0)
    went = (core.judged.qpos[:, 0] - began) / (seconds - BEGIN)
    return Walk(float(np.mean(late)) + CONTROL_STEP, float(went.mean()), legs[:, [FRICTION, ROTOR]].T)


def main() -> None:
    """Print a table of the walks and one of what was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--speed", type=float, default=0.3, help="command [m/s] (default: %(default)s)")
    parser.add_argument("--robots", type=int, default=4, help="of each kind (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each walk (default: %(default)s)")
    given = parser.parse_args()
    print("| | blind: lands after T | speed | finding its joints: lands after T | speed |")
    print(f"|{'---|' * 5}")
    found = {}
    for name, profile in ROBOTS.items():
        walks = [walk(profile, given.speed, given.robots, given.seconds, blind) for blind in (True, False)]
        print(f"| {name} |", " | ".join(f"{1e3 * w.late:.0f} ms | {w.speed:.2f} m/s" for w in walks), "|")
        found[name] = walks[1].found
    print(f"\n| | | {' | '.join(JOINTS)} |\n|---|---|{'---|' * len(JOINTS)}")
    for name, values in found.items():
        for what, row, digits in (("friction [N m]", 0, 2), ("rotor [kg m^2]", 1, 3)):
            print(f"| {name} | {what} |", " | ".join(f"{v:.{digits}f}" for v in values[row]), "|")


if __name__ == "__main__":
    main()
