"""A directory of `evaluate` as somebody hands it in: read, and every row held against its scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.files import read_file
from ...controllers.json_text import parse_json
from ...envs.biped.bounds_record import BoundsReport
from ...envs.scenario.scenario import Scenario
from ..rollout.environments import EnvName, profile_on
from ..rollout.names import DEFAULT_ENV
from ..rollout.outcome import Ending, Outcome, Score
from ..score.evaluate import FORMAT, configuration
from ..score.suites import OF_ROBOT, SUITES, Suite, get_suite, with_profile

Row = dict[str, Any]
DIGEST = "policy_sha256"  # of a row, beside its outcome


@dataclass(frozen=True)
class Submission:
    """Rows of policies on one suite, complete and consistent."""

    directory: Path
    suite: Suite
    env_id: str
    code: str  # hash of the sources that gave the rows
    rows: Mapping[str, Sequence[Row]]  # policy -> rows in the suite's order

    def digest(self, policy: str) -> str | None:
        """SHA-256 of the policy, as its rows state it; None for a name."""
        return self.rows[policy][0][DIGEST]


def read_submission(directory: Path, suite: str | None = None) -> Submission:
    """Read a directory, and check all of it that can be checked without running anything.

    Args:
        directory: of `evaluate`.
        suite: name or file; by default the built-in one that the directory names.

    Raises:
        InvalidValueError: files that are missing or no results; results of other code or of another suite;
            rows that are missing, come twice, or contradict their scenario, each other, or the report.
    """
    config = _object(directory / "config.json")
    summary = config.get("suite")
    if config.get("format") != FORMAT or not isinstance(summary, dict):
        raise InvalidValueError(f"{str(directory)!r} holds no results of evaluate (format {FORMAT})")
    env_id = str(config.get("env"))
    pushes = _suite(str(summary.get("name")), suite, env_id)
    known = configuration(pushes, env_id)
    if differs := [name for name in sorted({*known, *config}) if known.get(name) != config.get(name)]:
        raise InvalidValueError(
            f"{str(directory)!r} can't be checked by running it again: it belongs to another "
            f"{' and another '.join(differs)} than this installation has"
        )
    rows = _rows(directory / "outcomes.jsonl", pushes)
    _check_report(directory / "report.json", rows)
    return Submission(directory, pushes, env_id, config["code"], rows)


def _object(path: Path) -> dict[str, Any]:
    try:
        content = parse_json(repr(str(path)), read_file(path))
    except OSError as error:
        raise InvalidValueError(f"cannot read {str(path)!r}: {error.strerror or error}") from error
    if not isinstance(content, dict):
        raise InvalidValueError(f"{str(path)!r} holds no JSON object")
    return content


def _suite(name: str, given: str | None, env_id: str) -> Suite:
    """The suite of a name as `evaluate` gives it, for a robot or with a profile, unless another is given."""
    if given is not None:
        return get_suite(given)
    whole, plus, profile = name.partition("+")
    base, at, _ = whole.partition(OF_ROBOT)
    # a name in a file that is handed in opens no other file, and runs no code
    if base not in SUITES or (at and EnvName.parse(env_id).runs_code):
        raise InvalidValueError(f"suite {name!r} of the results is not built in: name its file with --suite")
    own = env_id if at else DEFAULT_ENV
    pushes = get_suite(base, own)
    return with_profile(pushes, profile_on(own, profile)) if plus else pushes


def _rows(path: Path, suite: Suite) -> dict[str, list[Row]]:
    """Rows by policy in the suite's order, every one of them there once."""
    try:
        lines = read_file(path).splitlines()
    except OSError as error:
        raise InvalidValueError(f"cannot read {str(path)!r}: {error.strerror or error}") from error
    scenarios, found = {s.id: s for s in suite.scenarios}, {}
    for number, line in enumerate(lines, start=1):
        row = parse_json(f"{str(path)!r} line {number}", line)
        policy, scenario_id = (
            row.get(key) if isinstance(row, dict) else None for key in ("policy", "scenario_id")
        )
        if not isinstance(policy, str) or scenario_id not in scenarios:
            raise InvalidValueError(f"{str(path)!r} line {number} is no row of suite {suite.name!r}")
        if scenario_id in found.setdefault(policy, {}):
            raise InvalidValueError(
                f"{str(path)!r} has scenario {scenario_id!r} of {policy!r} more than once"
            )
        found[policy][scenario_id] = checked_row(row, scenarios[scenario_id])
    for policy, rows in found.items():
        if missing := [name for name in scenarios if name not in rows]:
            raise InvalidValueError(
                f"{str(path)!r} lacks {len(missing)} rows of {policy!r}, such as {missing[0]!r}: only whole "
                "suites count"
            )
        if len({row[DIGEST] for row in rows.values()}) != 1:
            raise InvalidValueError(f"{str(path)!r} has rows of several contents of policy {policy!r}")
    if not found:
        raise InvalidValueError(f"{str(path)!r} holds no rows")
    return {policy: [rows[name] for name in scenarios] for policy, rows in found.items()}


def checked_row(row: Row, scenario: Scenario) -> Row:
    """The row, if all of it follows from the scenario and from how the episode ended.

    Raises:
        InvalidValueError: naming the fields that do not.
    """
    said = {key: value for key, value in row.items() if key != DIGEST}
    try:
        bounds = BoundsReport(dict(said["limits_met"]), dict(said["limit_shares"]))
        ending = Ending(
            not said["survived"],
            said["end_time"],
            said["recovered_at"],
            said["failure_reason"],
            said["total_reward"],
            bounds,
            said.get("measures", {}),
        )
        follows = Outcome.of(scenario, said["policy"], ending, said["env_steps"]).to_dict()
        if DIGEST not in row:
            raise KeyError(DIGEST)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InvalidValueError(
            f"row {scenario.id!r} of {row.get('policy')!r} is no outcome: {error!r}"
        ) from error
    differs = [key for key in sorted({*said, *follows}) if said.get(key) != follows.get(key)]
    if differs or not isinstance(said["survived"], bool):
        raise InvalidValueError(
            f"row {scenario.id!r} of {row['policy']!r} contradicts its scenario or itself in: "
            f"{', '.join(differs or ['survived'])}"
        )
    return row


def _check_report(path: Path, rows: Mapping[str, Sequence[Row]]) -> None:
    """Where there is a report, its counts are those of the rows."""
    if not path.is_file():
        return
    told = _object(path).get("policies")
    for policy, mine in rows.items():
        score = Score.of(mine).to_dict()
        entry = told.get(policy, {}) if isinstance(told, dict) else {}
        if differs := [key for key in score if entry and entry.get(key) != score[key]]:
            raise InvalidValueError(
                f"{str(path)!r} tells other numbers of {policy!r} than the rows give: {', '.join(differs)}"
            )
