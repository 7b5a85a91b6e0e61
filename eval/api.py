"""The functions that users call: `evaluate`, `compare`, `frontier` and `rollout`."""

from os import PathLike
from pathlib import Path
from typing import Any

import gymnasium as gym

from ..controllers.errors import InvalidValueError, shown
from ..controllers.validation import require_integer, require_kind
from ..envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from ..envs.scenario.push import Body
from ..envs.scenario.scenario import Command, Scenario
from .ceiling import with_ceiling
from .rollout import DEFAULT_ENV, REPLICAS, TABLE_VARIANTS, environments, policy_source
from .rollout.episodes import rollout as run_episode
from .rollout.outcome import Outcome
from .score import evaluate as scoring
from .score import frontier as scanning
from .score.report import write_evaluation_reports
from .score.suites import Suite, on_robots, pushes_on


def evaluate(
    policies: Any = TABLE_VARIANTS,
    suite: Suite | str | PathLike[str] | None = None,
    env: str = DEFAULT_ENV,
    *,
    errors: ModelErrors = EXACT_MODEL,
    profile: str = "exact",
    workers: int = 1,
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
) -> scoring.Evaluation:
    """Score policies on a suite, and write rows and reports; a run that was stopped goes on where it was.

        evaluation = evaluate(policies={"mine": my_policy, "two-stage": "two-stage"}, suite="hard")
        evaluation.score("mine").rate

    Args:
        policies: one or several, or a mapping of labels to them: a name, a file, "MODULE:ATTRIBUTE", or an
            object with `predict(observation)`. State, episode_start and deterministic are handed over where
            the signature takes them; (action, state) or the action alone may be returned.
        suite: a suite, its name, or its file; by default `quick`, and `quick-1` on the pendulum.
        env: id of a gait environment.
        errors: what robot and floor are off from the planner's model, in every scenario.
        profile: of the robot, a name of `PROFILES`; `errors` stand where both say something.
        workers: processes, which change no result. More than one start this script anew, so that it needs
            `if __name__ == "__main__"`, and need policies that pickle; `ray_workers` gives those of a
            cluster.
        out: directory of the results; by default one under runs/ named after the configuration. Rows of an
            object that can't be pickled, such as a model together with its environment, are not gone on with.
        overwrite: start over where the directory holds results.

    Returns:
        Rows by policy, scores, and the directory that the reports are in.

    Raises:
        PushRecoveryError: unknown names, a directory of another configuration, a policy that can't act.
    """
    chosen, directory = _suite(suite, env, errors, profile), _directory(out, workers)
    evaluation = scoring.evaluate(chosen, env, policies, workers, directory, overwrite)
    write_evaluation_reports(evaluation, with_ceiling(evaluation, workers, overwrite))
    return evaluation


def compare(
    a: Any,
    b: Any,
    suite: Suite | str | PathLike[str] | None = None,
    env: str = DEFAULT_ENV,
    *,
    errors: ModelErrors = EXACT_MODEL,
    profile: str = "exact",
    workers: int = 1,
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
) -> scoring.Comparison:
    """Two policies on the same pushes, paired by scenario; arguments as those of `evaluate`.

    Labels tell policies of one class apart: compare({"before": a}, {"after": b}).

    Raises:
        PushRecoveryError: as `evaluate`.
    """
    chosen, directory = _suite(suite, env, errors, profile), _directory(out, workers)
    return scoring.compare(a, b, chosen, env, workers, directory, overwrite)


def _suite(suite: Suite | str | PathLike[str] | None, env: str, errors: ModelErrors, profile: str) -> Suite:
    require_kind("errors", errors, ModelErrors)
    if isinstance(suite, Suite):
        return on_robots(suite, errors, profile, env)
    return pushes_on(env, None if suite is None else str(suite), errors, profile)


def _directory(out: str | PathLike[str] | None, workers: int) -> Path | None:
    """The directory of a run; raises InvalidValueError for what is none, or no number of workers."""
    require_integer("workers", workers, 1)
    if not isinstance(out, str | PathLike | None):
        raise InvalidValueError(f"out must be a path, got {shown(out)}")
    return None if out is None else Path(out)


def frontier(
    policies: Any = "two-stage",
    directions: int = 16,
    env: str = DEFAULT_ENV,
    *,
    grid: float | None = None,
    duration: float = 0.1,
    body: Body = "pelvis",
    command: Command = Command(),  # noqa: B008  # frozen
    errors: ModelErrors = EXACT_MODEL,
    profile: str = "exact",
    replicas: int = REPLICAS,
    replica_seed: int = 0,
    workers: int = 1,
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
) -> scanning.Frontier:
    """Find the largest push that is recovered from, by direction, on a left stance after four nominal steps.

    Each force is tried on replicas; the threshold is the force up to which 0.8 of them recover. Under
    `Command(stand=True)` the robot is pushed at rest on both feet, and what it catches without a step is
    found, too.

    Args:
        policies: as those of `evaluate`.
        directions: how many, counter-clockwise from forward.
        env: id of a gait environment.
        grid: least step of the force [N]; by default 40 for 60 kg and as much less for less, with one replica
            10 on the pendulum, 20 elsewhere.
        duration: of the push [s].
        body: that is pushed.
        command: velocity that is walked at, or to stand.
        errors: what robot and floor are off from the planner's model.
        profile: of the robot, a name of `PROFILES`; `errors` stand where both say something.
        replicas: how many, which differ in phase of the step, start and noise; 1: the nominal trajectory.
        replica_seed: that they are drawn from.
        workers: processes, see `evaluate`.
        out: directory of the results; by default one under runs/ named after the configuration.
        overwrite: start over where the directory holds results.

    Raises:
        PushRecoveryError: unknown names, a directory of another configuration, a policy that can't act.
    """
    directory = _directory(out, workers)
    step = scanning.default_grid(env, replicas) if grid is None else grid
    settings = scanning.FrontierSettings(
        env, step, duration, body, command, errors, profile, replicas, replica_seed
    )
    return scanning.frontier(settings, policies, directions, workers, directory, overwrite)


def rollout(
    policy: Any = "two-stage",
    scenario: Scenario = Scenario("unpushed"),  # noqa: B008  # frozen
    env: gym.Env | str = DEFAULT_ENV,
    policy_name: str | None = None,
    *,
    profile: str = "exact",
) -> Outcome:
    """Run one scenario to its end: the row that an evaluation writes. `record` takes the same arguments.

    Args:
        policy: a name, a file, "MODULE:ATTRIBUTE", or an object with `predict(observation)`.
        scenario: what happens.
        env: a gait environment, or its id. Three arguments in the order of old, environment, policy and
            scenario, are understood, too.
        policy_name: of the outcome; by default the name, or the object's class.
        profile: of the robot, a name of `PROFILES`; what the scenario says itself stands.

    Raises:
        PushRecoveryError: unknown names, a policy that can't act.
    """
    if isinstance(env, Scenario):  # the order of old
        policy, scenario, env = scenario, env, policy
    require_kind("scenario", scenario, Scenario)
    with policy_source.acting_in(env, policy, policy_name) as (made, acting, label):
        return run_episode(made, acting, environments.under_profile(made, scenario, profile), label)
