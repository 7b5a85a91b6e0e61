"""What a DCM error is worth at the end of a step: python benchmarks/value_at_touchdown.py [PUSHES_A_CELL].

The planner meets development pushes like those of `hard`. Of the first touchdown after a push with an error
e = (e_x, e_y) of the DCM against the nominal gait of more than 3 cm, canonical frame, and of the trunk's
angles and rates there, a logistic regression learns whether the robot will recover. Printed are how well each
set of features tells the two apart (area under the ROC curve, on folds that were left out), and the weights.
Stage 1 prices e by  alpha_offset |e|^2,  the same in x and y.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray
from push_recovery.controllers.model.nominal_gait import NOMINAL_SIZE, nominal_gait_kernel
from push_recovery.controllers.model.observation import COMMAND, ELAPSED, TRUNK_ANGLE, TRUNK_RATE
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode.recovery import nominal_dcm_kernel, started_dcm_kernel
from push_recovery.eval.rollout import default_workers
from push_recovery.eval.score.kinds import DRAWS
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import mannwhitneyu

Array = NDArray[np.float64]
ROBOTS, SEED, FOLDS = 64, 777, 8
LEAST = 0.03  # of an error that a push has made [m]
UNITS = np.array([0.1, 0.1, 0.2, 0.2, 1.0, 1.0])  # error [m], lean [rad], rate [rad/s]


def touchdowns(cells: int) -> tuple[Array, NDArray[np.bool_]]:
    """States (n, 6) at the touchdowns meant above, in `UNITS`, and whether the robot recovered (n,)."""
    episodes = BipedEpisodes(ROBOTS, threads=default_workers())
    robot, low, high = episodes.robot, episodes.limits.low, episodes.limits.high
    planner = make_policy("two-stage", robot, episodes.limits, episodes.preset)
    delay = planner.config.touchdown_delay  # type: ignore[union-attr]
    nominal, start, started, level = np.empty(NOMINAL_SIZE), np.empty(2), np.empty(2), np.zeros(2)

    def state(obs: Array) -> Array:
        nominal_gait_kernel(*obs[COMMAND][:2], robot.pelvis_width, low, high, robot.omega, delay, nominal)
        nominal_dcm_kernel(nominal, robot.pelvis_width, robot.omega, delay, 0.0, start)
        started_dcm_kernel(obs, level, 0.0, robot.omega, started)
        return np.concatenate([started - start, obs[TRUNK_ANGLE], obs[TRUNK_RATE]]) / UNITS

    scenarios, states, recovered = DRAWS["hard"].stratified("value", cells, SEED), [], []
    for first in range(0, len(scenarios), ROBOTS):
        chunk = scenarios[first : first + ROBOTS]
        for k, scenario in enumerate(chunk):
            episodes.begin(k, scenario)
        found: dict[int, Array] = {}
        live = np.arange(len(chunk))
        while len(live):
            before = episodes.core.observation[:, ELAPSED].copy()
            period = episodes.step(planner.predict(episodes.core.observation)[0])
            over = period.failed | period.truncated
            for k in live:
                obs = episodes.core.observation[k]
                if k not in found and obs[ELAPSED] < before[k]:
                    told = state(obs)
                    if np.hypot(*(told * UNITS)[:2]) > LEAST:
                        found[k] = told
                if over[k] and k in found:
                    states.append(found[k])
                    recovered.append(not period.failed[k] and episodes.monitor.recovered_at(k) is not None)
            live = live[~over[live]]
    return np.array(states), np.array(recovered)


def fitted(features: Array, recovered: NDArray[np.bool_]) -> Array:
    """Weights of a logistic regression with a penalty of |w|^2 / 2, the constant first."""
    columns, sign = np.c_[np.ones(len(features)), features], np.where(recovered, 1.0, -1.0)

    def loss(w: Array) -> tuple[float, Array]:
        told = sign * (columns @ w)
        return np.logaddexp(0.0, -told).sum() + 0.5 * w @ w, w - columns.T @ (sign * expit(-told))

    return minimize(loss, np.zeros(columns.shape[1]), jac=True).x


def told_apart(features: Array, recovered: NDArray[np.bool_]) -> float:
    """Area under the ROC curve of what the other folds have taught."""
    fold, scores = np.arange(len(recovered)) % FOLDS, np.empty(len(recovered))
    for out in range(FOLDS):
        weights = fitted(features[fold != out], recovered[fold != out])
        scores[fold == out] = features[fold == out] @ weights[1:] + weights[0]
    yes, no = scores[recovered], scores[~recovered]
    return float(mannwhitneyu(yes, no).statistic) / (len(yes) * len(no))


def main() -> None:
    """Print a line for each set of features."""
    states, recovered = touchdowns(int(sys.argv[1]) if len(sys.argv) > 1 else 12)
    x, y = states[:, 0], states[:, 1]
    products = [states[:, i] * states[:, j] for i in range(6) for j in range(i, 6)]
    sets = {
        "|e|": np.hypot(x, y)[:, None],
        "e_x^2, e_y^2": np.c_[x**2, y**2],
        "e_x, e_y, e_x^2, e_y^2, e_x e_y": np.c_[x, y, x**2, y**2, x * y],
        "all of second order, the trunk's too": np.c_[states, np.array(products).T],
    }
    print(f"{len(states)} touchdowns, {recovered.mean():.3f} of their robots recover")
    for name, features in sets.items():
        weights = fitted(features, recovered)
        shown = " ".join(f"{w:.2f}" for w in weights) if len(weights) < 10 else ""
        print(f"{name}: area {told_apart(features, recovered):.3f}; weights {shown}")


if __name__ == "__main__":
    main()
