"""Answers to the pushes of shipped suites: each report of such a suite gets the row `ceiling`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..rollout.environments import make_env
from ..rollout.names import DEFAULT_ENV
from ..score.evaluate import Evaluation, evaluate
from ..score.suites import Suite
from .answers import Answers
from .run import best_rows
from .search import CEILING

REPLAYED = "ceiling-replayed"  # folder of the rows, below the directory of the evaluation
STORED = Path(__file__).parent / "stored"


def stored_answers(suite: Suite) -> Answers | None:
    """Those to the pushes of a suite; None where there are none to just these pushes."""
    path = STORED / f"{suite.name}.json"
    if not path.is_file():
        return None
    answers = Answers.load(path)
    return answers if answers.suite["sha256"] == suite.sha256 else None


def with_ceiling(evaluation: Evaluation, workers: int = 1, overwrite: bool = False) -> Evaluation:
    """The evaluation with the ceiling among its policies, where answers to its suite are stored.

    They are replayed on today's robot, so that only what they recover on it counts.
    """
    answers = stored_answers(evaluation.suite) if evaluation.env_id == DEFAULT_ENV else None
    if answers is None or CEILING in evaluation.rows:
        return evaluation
    pushes = tuple(one for one in evaluation.suite.scenarios if one.id in answers.sequences)
    if not pushes:
        return evaluation
    suite = Suite(f"{evaluation.suite.name}-answered", evaluation.suite.version, pushes)
    env = make_env(evaluation.env_id)
    policy = answers.policy(env)
    env.close()
    replayed = evaluate(
        suite, evaluation.env_id, {CEILING: policy}, workers, evaluation.directory / REPLAYED, overwrite
    )
    rows = best_rows(evaluation, replayed.rows[CEILING])
    return replace(evaluation, rows={**evaluation.rows, CEILING: rows})
