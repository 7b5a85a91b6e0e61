"""A suite and a policy of your own: eight directions of one push, scored beside the first stage."""

import math
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from push_recovery.envs.scenario.push import polar_push
from push_recovery.eval.score.suites import Suite

from push_recovery import GaitEvent, Scenario, evaluate


class Mine:
    """Steps every 0.15 s to where the DCM will be; CoP and trunk stay at rest."""

    low, high = np.array([[-0.335, 0.111, 0.115], [0.431, 0.62, 0.491]])  # length, width [m], time [s]

    def predict(self, observation):
        """Action (7,) of an observation (36,)."""
        x, y = observation[1:3] * np.exp(3.5 * (0.15 - observation[0]))
        gait = x - 0.22 * observation[25], y + 0.074, 0.15
        return np.append(2 * (gait - self.low) / (self.high - self.low) - 1, np.zeros(4))


def scenario(degrees):
    """60 N s in one direction, at the start of a step on the left foot."""
    return Scenario(f"{degrees} deg", (polar_push(600.0, math.radians(degrees), 0.1, GaitEvent(4, "left")),))


if __name__ == "__main__":
    folder = Path(mkdtemp())
    suite = Suite("compass", "1", tuple(scenario(degrees) for degrees in range(0, 360, 45)))
    suite.save(folder / "compass.json")  # push-recovery evaluate --suite compass.json takes it, too
    found = evaluate({"mine": Mine(), "stage-1": "stage-1"}, suite, out=folder / "results")
    for name in found.rows:
        print(f"{name}: {found.score(name).recovered} of {len(suite.scenarios)} pushes of 60 N s recovered")
    print(f"suite and report: {folder}")
