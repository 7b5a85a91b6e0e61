"""Every eighth push of `hard` on a robot's own sensors: recoveries, errors of the estimate.

python benchmarks/onboard.py [PROFILE] [ARM]
"""

import sys

import numpy as np
from push_recovery.controllers.policies.arms import make_policy
from push_recovery.controllers.whole_body.kinematics import PELVIS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode.profile import get_profile
from push_recovery.eval.rollout.batch import rollout_batch
from push_recovery.eval.score.suites import get_suite


def main(profile: str = "exact", arm: str = "two-stage") -> None:
    """Print what came out with either sensing."""
    scenarios = [get_profile(profile).applied(s) for s in get_suite("hard").scenarios[::8]]
    for sensing in ("exact", "onboard"):
        episodes, errors = BipedEpisodes(32, sensing=sensing), []
        core, step = episodes.core, episodes.core.step

        def watched(gaits, actions, core=core, step=step, errors=errors) -> None:
            step(gaits, actions)
            up = core.gait.failure == 0
            velocity = core.physics.qvel[up, :3] - core.judged.qvel[up, :3]
            believed, true = (phys.xmat[up, PELVIS, 2::3] for phys in (core.physics, core.judged))
            errors.append(np.column_stack([velocity, np.cross(believed, true)]))

        core.step = watched
        policy = make_policy(arm, episodes.robot, episodes.limits, episodes.preset)
        outcomes = list(rollout_batch(episodes, policy, scenarios, arm))
        recovered, survived = (sum(getattr(o, name) for o in outcomes) for name in ("recovered", "survived"))
        rms = np.sqrt((np.concatenate(errors) ** 2).mean(axis=0))
        tilt = np.degrees(np.linalg.norm(rms[3:]))
        print(f"{profile} {sensing} {arm}: recovered {recovered}, survived {survived} of {len(outcomes)};")
        print(f"  base velocity rms {rms[:3].round(4)} m/s, tilt rms {tilt:.2f} degrees")


if __name__ == "__main__":
    main(*sys.argv[1:])
