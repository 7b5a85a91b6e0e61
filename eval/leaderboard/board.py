"""The board: a file for each policy on a suite, and the page that is made of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.files import read_file, write_text
from ...controllers.json_text import parse_json
from ..output.tables import markdown_table
from ..rollout.outcome import Score
from .submission import Submission

KEY = 16  # hexadecimal digits of a hash in the name of a file
PAGE = "README.md"
COLUMNS = ("policy", "recovered", "rate", "95 % interval", "survived", "policy hash", "code", "checked")
FIELDS = {"suite", "env", "policy", "policy_sha256", "code", "rows_sha256", "score", "checked"}

Entry = dict[str, Any]


def policy_key(entry: Entry) -> str:
    """Hash of the policy as it was run: its content or its name, its environment, and the code."""
    named = [entry["policy"] if entry["policy_sha256"] is None else "", entry["policy_sha256"]]
    text = json.dumps([*named, entry["env"], entry["code"]])
    return hashlib.sha256(text.encode()).hexdigest()


def entry_of(submission: Submission, policy: str, checked: int) -> Entry:
    """What the board keeps of a policy; `checked` of its rows were run again."""
    rows = submission.rows[policy]
    lines = "\n".join(json.dumps(row, sort_keys=True) for row in rows)
    return {
        "suite": submission.suite.summary(),
        "env": submission.env_id,
        "policy": policy,
        "policy_sha256": submission.digest(policy),
        "code": submission.code,
        "rows_sha256": hashlib.sha256(lines.encode()).hexdigest(),
        "score": Score.of(rows).to_dict(),
        "checked": checked,
    }


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
        entry = parse_json(repr(str(path)), read_file(path))
        if not isinstance(entry, dict) or not entry.keys() >= FIELDS:
            raise InvalidValueError(f"{str(path)!r} is no entry of a leaderboard")
        place = entry["suite"]["sha256"][:KEY], f"{policy_key(entry)[:KEY]}.json"
        if place != (path.parent.name, path.name):
            raise InvalidValueError(f"{str(path)!r} holds an entry that belongs in {'/'.join(place)}")
        entries.append(entry)
    return entries


def board_page(entries: Sequence[Entry]) -> str:
    """A table for each suite and environment, the best recovery first."""
    groups: dict[tuple[str, str, str], list[Entry]] = {}
    for entry in entries:
        suite = entry["suite"]
        groups.setdefault((suite["name"], suite["sha256"], entry["env"]), []).append(entry)
    parts = ["# Leaderboard\n\nMade by `push-recovery submit` from the files beside it; don't edit it.\n"]
    for (name, digest, env), group in sorted(groups.items()):
        ranked = sorted(
            group, key=lambda entry: (-entry["score"]["recovered"], entry["policy"], policy_key(entry))
        )
        table = markdown_table(COLUMNS, [_cells(entry) for entry in ranked])
        parts.append(f"\n## {name}, {env}\n\nSuite SHA-256 `{digest}`.\n\n{table}")
    if not entries:
        return f"{parts[0]}\nNo results yet.\n"
    parts.append(
        "\nRecovered counts; intervals are Wilson's, 95 %. Checked: rows that were run again, bit for bit, "
        "when the entry was made. Rows of different code are not of one robot: compare those of equal code.\n"
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
        "-" if digest is None else f"`{digest[:8]}`",
        f"`{entry['code'][:8]}`",
        f"{entry['checked']} of {score['episodes']}",
    )
