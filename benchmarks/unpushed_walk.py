"""What a policy changes of an unpushed walk: python benchmarks/unpushed_walk.py POLICY [SECONDS [ENV]].

For five commands under both profiles: mean velocity, step time, largest lean of the trunk and rms torque, of
two-stage and of the policy, and whether every recorded number is the same bit for bit.
"""

from __future__ import annotations

import sys

import numpy as np
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.record.record import EpisodeRecord, record
from push_recovery.eval.rollout import DEFAULT_ENV

COMMANDS = ((0.0, 0.0), (0.4, 0.0), (-0.2, 0.0), (0.0, 0.15), (0.3, 0.1))
BEGUN = 100  # samples, after which velocities are taken


def figures(episode: EpisodeRecord) -> tuple[float, ...]:
    """Velocity forward and to the left [m/s], step time [s], lean [rad], torque [N m]."""
    time = episode["time"]
    vx, vy = (
        (episode[name][-1] - episode[name][BEGUN]) / (time[-1] - time[BEGUN]) for name in ("com_x", "com_y")
    )
    lean = max(np.abs(episode[name]).max() for name in ("trunk_pitch", "trunk_roll"))
    torques = [values for name, values in episode.columns.items() if name.startswith("torque_")]
    return vx, vy, time[-1] / episode["step"][-1], lean, float(np.sqrt(np.mean(np.square(torques))))


def main() -> None:
    """Print a row for each walk."""
    policy, seconds = sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else 60.0
    env = sys.argv[3] if len(sys.argv) > 3 else DEFAULT_ENV
    print("profile, command: vx, vy, step time, lean, torque of two-stage/policy")
    for profile in ("exact", "hardware"):
        for vx, vy in COMMANDS:
            scenario = Scenario("unpushed", duration=seconds, command=Command(vx=vx, vy=vy))
            base, mine = (record(name, scenario, env, profile=profile) for name in ("two-stage", policy))
            same = all(np.array_equal(base[name], mine[name], equal_nan=True) for name in base.columns)
            pairs = (f"{a:.4f}/{b:.4f}" for a, b in zip(figures(base), figures(mine), strict=True))
            print(f"{profile} {vx:+.2f} {vy:+.2f}:", *pairs, "equal" if same else "different", flush=True)


if __name__ == "__main__":
    main()
