"""The leaderboard: results that are handed in, checked by running a sample again, and shown.

A directory of `evaluate` is read and every row held against its scenario; a random sample of the rows is run
again, of which every bit has to be the same; the board has a file for each policy on a suite, and a page.
"""

import hashlib
import json
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError, shown
from ...controllers.files import write_text
from ...controllers.validation import (
    Check,
    check_fields,
    or_none,
    parse_json,
    require_integer,
    require_number,
    require_object,
    require_pair,
    require_text,
)
from ...envs.biped.limits_record import LimitsReport
from ...envs.scenario.scenario import Scenario
from ..output import progress, tables
from ..output.rows import differing, read_content, read_json
from ..rollout import DEFAULT_ENV, environments, policy_source
from ..rollout.contract_files import trusted
from ..rollout.load_policy import is_attribute
from ..rollout.outcome import NONE_DRIVEN, Ending, Outcome, Score, check_row, driven_joints
from ..rollout.workers import chunk_sizes, make_chunks, parallel, run_chunk
from .evaluate import FORMAT, configuration
from .suites import OF_ROBOT, SUITES, Suite, get_suite, with_profile

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


def read_submission(directory: Path, suite: str | None = None, trust: bool = False) -> Submission:
    """Read a directory, and check all of it that can be checked without running anything.

    Args:
        directory: of `evaluate`.
        suite: name or file; by default the built-in one that the directory names.
        trust: whether a module that the results name may be imported.

    Raises:
        InvalidValueError: a module that is not trusted; files that are missing or no results; results of
            other code or of another suite; rows that are missing, come twice, or contradict their scenario,
            each other, or the report.
    """
    config = _object(directory / "config.json")
    summary = config.get("suite")
    if config.get("format") != FORMAT or not isinstance(summary, dict):
        raise InvalidValueError(f"{str(directory)!r} holds no results of evaluate (format {FORMAT})")
    env_id = str(config.get("env"))
    named = environments.EnvName.parse(env_id)
    if not trust and named.runs_code:
        raise InvalidValueError(
            f"{str(directory)!r} has results on {env_id!r}, and making it runs the code of a module: where "
            "you trust it, submit takes --trust"
        )
    pushes = _suite(str(summary.get("name")), str(summary.get("version")), suite, env_id)
    known = configuration(pushes, env_id)
    if differs := differing(known, config):
        raise InvalidValueError(
            f"{str(directory)!r} can't be checked by running it again: it belongs to another "
            f"{' and another '.join(differs)} than this installation has"
        )
    rows = _rows(directory / "outcomes.jsonl", pushes)
    _check_report(directory / "report.json", rows)
    return Submission(directory, pushes, env_id, config["code"], rows)


def _object(path: Path) -> dict[str, Any]:
    content = read_json(path)
    if not isinstance(content, dict):
        raise InvalidValueError(f"{str(path)!r} holds no JSON object")
    return content


def _suite(name: str, version: str, given: str | None, env_id: str) -> Suite:
    """The suite of a name as `evaluate` gives it, for a robot or with a profile, unless another is given.

    One that has a later version is built in as NAME-VERSION, too.
    """
    if given is not None:
        pushes = get_suite(given, env_id)
        own, plus, profile = name.rpartition("+")
        if plus and own == pushes.name:
            return with_profile(pushes, environments.profile_on(env_id, profile))
        return pushes
    whole, plus, profile = name.partition("+")
    base, at, _ = whole.partition(OF_ROBOT)
    # a name in a file that is handed in opens no other file, and runs no code
    if base not in SUITES or (at and environments.EnvName.parse(env_id).runs_code):
        raise InvalidValueError(f"suite {name!r} of the results is not built in: name its file with --suite")
    own = env_id if at else DEFAULT_ENV
    base = former if (former := f"{base}-{version}") in SUITES else base
    pushes = get_suite(base, own)
    return with_profile(pushes, environments.profile_on(own, profile)) if plus else pushes


def _rows(path: Path, suite: Suite) -> dict[str, list[Row]]:
    """Rows by policy in the suite's order, every one of them there once."""
    scenarios, found = {s.id: s for s in suite.scenarios}, {}
    for number, line in enumerate(read_content(path).splitlines(), start=1):
        row = parse_json(f"{str(path)!r} line {number}", line)
        told = row if isinstance(row, dict) else {}
        policy, scenario_id = told.get("policy"), told.get("scenario_id")
        if not (isinstance(policy, str) and isinstance(scenario_id, str) and scenario_id in scenarios):
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
        InvalidValueError: naming the fields that do not, or the one that has no value of an outcome.
    """
    try:
        check_row(row, optional=("kick", "measures"))
    except InvalidValueError as error:
        raise InvalidValueError(
            f"row {scenario.id!r} of {row.get('policy')!r} is no outcome: {error}"
        ) from error
    outcome = {key: value for key, value in row.items() if key != DIGEST}
    bounds = LimitsReport(outcome["limits_met"], outcome["limit_shares"])
    names = "end_time", "recovered_at", "failure_reason", "total_reward"
    end, settled, reason, reward = (outcome[name] for name in names)
    measures = outcome.get("measures", {})
    ending = Ending(not outcome["survived"], end, settled, reason, reward, bounds, measures)
    follows = Outcome.of(scenario, outcome["policy"], ending, outcome["env_steps"]).to_dict()
    if differs := differing(outcome, follows):
        raise InvalidValueError(
            f"row {scenario.id!r} of {row['policy']!r} contradicts its scenario or itself in: "
            f"{', '.join(differs)}"
        )
    return row


def _check_report(path: Path, rows: Mapping[str, Sequence[Row]]) -> None:
    """Where there is a report, its counts are those of the rows."""
    if not path.is_file():
        return
    reported = require_object(f"policies of {str(path)!r}", _object(path).get("policies"))
    for policy, mine in rows.items():
        score = Score.of(mine).to_dict()
        entry = require_object(f"policy {policy!r} of {str(path)!r}", reported.get(policy, {}))
        if differs := [key for key in score if entry and entry.get(key) != score[key]]:
            raise InvalidValueError(
                f"{str(path)!r} tells other numbers of {policy!r} than the rows give: {', '.join(differs)}"
            )


def sample_of(submission: Submission, size: int, seed: int | None = None) -> dict[str, list[Scenario]]:
    """Scenarios of each policy that are run again, drawn anew each time unless a seed is given."""
    generator = random.SystemRandom() if seed is None else random.Random(seed)  # noqa: S311 (a stated sample)
    scenarios = submission.suite.scenarios
    return {policy: generator.sample(scenarios, min(size, len(scenarios))) for policy in submission.rows}


def run_again(
    submission: Submission, samples: dict[str, list[Scenario]], workers: int = 1, trust: bool = False
) -> None:
    """Run samples again.

    Raises:
        InvalidValueError: a policy is code that is not trusted, or not the one that its rows state; or a row
            is not what comes now.
        PushRecoveryError: a policy cannot be loaded.
    """
    sources = policy_source.policy_sources([trusted(name) if trust else name for name in submission.rows])
    for name, source in sources.items():
        if not trust and isinstance(source.origin, str) and is_attribute(source.origin):
            raise InvalidValueError(
                f"policy {name!r} of the rows is code of a module: where you trust it, submit takes --trust"
            )
        if source.digest() != submission.digest(name):
            raise InvalidValueError(
                f"policy {name!r} is not the one of the rows: they state SHA-256 {submission.digest(name)}, "
                f"it has {source.digest()}"
            )
    rows = {(name, row["scenario_id"]): row for name, given in submission.rows.items() for row in given}
    chunks = make_chunks(samples, chunk_sizes(submission.env_id, sources), workers)
    done = dict.fromkeys(samples, 0)
    seconds = policy_source.guessed_seconds(submission.env_id, samples, sources, workers)
    work = progress.Work(f"running {sum(map(len, samples.values()))} rows again", progress.about(seconds))
    with progress.progress_bars(list(samples), max(map(len, samples.values())), work) as bars:
        for outcomes in parallel(submission.env_id, run_chunk, chunks, workers, sources):
            for outcome in outcomes:
                _compare(rows[outcome.policy, outcome.scenario_id], outcome.to_dict())
                done[outcome.policy] += 1
                bars.set(outcome.policy, done[outcome.policy])


def _compare(given: Row, outcome: dict[str, Any]) -> None:
    """Raise InvalidValueError where an outcome is not the row that was handed in."""
    again = json.loads(json.dumps(outcome))
    stated = {key: value for key, value in given.items() if key != DIGEST}
    if differs := differing(stated, again):
        key = "recovered" if "recovered" in differs else differs[0]
        raise InvalidValueError(
            f"row {given['scenario_id']!r} of {given['policy']!r} is not what running it again gives: {key} "
            f"is {shown(stated.get(key))}, again {shown(again.get(key))} ({len(differs)} fields differ); on "
            "another kind of machine last bits may differ"
        )


DRIVEN = "targets_of"  # of an entry, which one of a policy that moves no joints itself does without
KEY = 16  # hexadecimal digits of a hash in the name of a file
PAGE = "README.md"
COLUMNS = (
    "policy", "recovered", "rate", "95 % interval", "survived", "targets of", "policy hash", "code", "checked"
)  # fmt: skip
SUITE: dict[str, Check] = {"name": require_text, "sha256": require_text}
SCORE: dict[str, Check] = {
    **dict.fromkeys(("recovered", "survived", "episodes"), require_integer),
    "rate": require_number,
    "ci95": require_pair,
}
FIELDS: dict[str, Check] = {  # of an entry
    "suite": lambda name, value: check_fields(value, SUITE, name=name),
    "env": require_text,
    "policy": require_text,
    "policy_sha256": or_none(require_text),
    "code": require_text,
    "rows_sha256": require_text,
    "score": lambda name, value: check_fields(value, SCORE, name=name),
    "checked": require_integer,
    DRIVEN: require_text,
}

Entry = dict[str, Any]


def policy_key(entry: Entry) -> str:
    """Hash of the policy as it was run: its content or its name, its environment, and the code."""
    named = [entry["policy"] if entry["policy_sha256"] is None else "", entry["policy_sha256"]]
    text = json.dumps([*named, entry["env"], entry["code"]])
    return hashlib.sha256(text.encode()).hexdigest()


def entry_of(submission: Submission, policy: str, checked: int) -> Entry:
    """Entry of the board for a policy; `checked` of its rows were run again."""
    rows = submission.rows[policy]
    lines = "\n".join(json.dumps(row, sort_keys=True) for row in rows)
    driven = driven_joints(rows)
    return {
        "suite": submission.suite.summary(),
        "env": submission.env_id,
        "policy": policy,
        "policy_sha256": submission.digest(policy),
        "code": submission.code,
        "rows_sha256": hashlib.sha256(lines.encode()).hexdigest(),
        "score": Score.of(rows).to_dict(),
        "checked": checked,
    } | ({} if driven == NONE_DRIVEN else {DRIVEN: driven})


def add_entry(board: Path, entry: Entry) -> Path:
    """Write an entry under the hashes of suite and policy, and the page anew; returns the entry's file."""
    path = board / entry["suite"]["sha256"][:KEY] / f"{policy_key(entry)[:KEY]}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(entry, indent=1) + "\n")
    write_text(board / PAGE, board_page(read_board(board)))
    return path


def read_board(board: Path) -> list[Entry]:
    """All entries.

    Raises:
        InvalidValueError: a file is no entry, or lies where another one belongs.
    """
    entries = []
    for path in sorted(board.glob("*/*.json")):
        entry = read_json(path)
        try:
            check_fields(entry, FIELDS, {DRIVEN})
        except InvalidValueError as error:
            raise InvalidValueError(f"{str(path)!r} is no entry of a leaderboard: {error}") from error
        place = entry["suite"]["sha256"][:KEY], f"{policy_key(entry)[:KEY]}.json"
        if place != (path.parent.name, path.name):
            raise InvalidValueError(f"{str(path)!r} holds an entry that belongs in {'/'.join(place)}")
        entries.append(entry)
    return entries


def board_page(entries: Sequence[Entry]) -> str:
    """A table for each suite and environment, the best recovery first."""
    parts = ["# Leaderboard\n\nMade by `push-recovery submit` from the files beside it; don't edit it.\n"]
    if not entries:
        return f"{parts[0]}\nNo results yet.\n"
    groups: dict[tuple[str, str, str], list[Entry]] = {}
    for entry in entries:
        suite = entry["suite"]
        groups.setdefault((suite["name"], suite["sha256"], entry["env"]), []).append(entry)
    for (name, digest, env), group in sorted(groups.items()):
        group.sort(key=lambda entry: (-entry["score"]["recovered"], entry["policy"], policy_key(entry)))
        table = tables.markdown_table(COLUMNS, [_cells(entry) for entry in group])
        parts.append(f"\n## {name}, {env}\n\nSuite SHA-256 `{digest}`.\n\n{table}")
    parts.append(
        "\nRecovered counts; intervals are Wilson's, 95 %. Checked: rows that were run again, bit for bit, "
        "when the entry was made. Targets of: how many joints a policy moves that was trained elsewhere and "
        "knows neither model nor velocity. Rows of different code are not of one robot: compare those of "
        "equal code.\n"
    )
    return "".join(parts)


def _cells(entry: Entry) -> tuple[str, ...]:
    score, digest = entry["score"], entry["policy_sha256"]
    low, high = score["ci95"]
    return (
        entry["policy"].replace("|", "\\|"),
        f"{score['recovered']}/{score['episodes']}",
        f"{score['rate']:.3f}",
        f"{low:.3f}-{high:.3f}",
        str(score["survived"]),
        entry.get(DRIVEN, NONE_DRIVEN).replace("|", "\\|"),
        "-" if digest is None else f"`{digest[:8]}`",
        f"`{entry['code'][:8]}`",
        f"{entry['checked']} of {score['episodes']}",
    )
