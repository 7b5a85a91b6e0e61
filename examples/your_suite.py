"""A suite and a policy of your own: eight directions of one push, scored beside the first stage."""

import math
from pathlib import Path
from tempfile import mkdtemp

from push_recovery.envs.scenario.push import polar_push
from push_recovery.eval.score.suites import Suite

from push_recovery import GaitEvent, Scenario, evaluate


class Mine:
    """Acts on nothing: the middle of every range, whatever is seen."""

    def predict(self, observation):
        """Action (7,) of an observation (36,), or (n, 7) of (n, 36)."""
        return 0.0 * observation[..., :7]


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
