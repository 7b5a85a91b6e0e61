"""Answers that searches have found, as a file and as a policy."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.files import read_file, write_text
from ...controllers.json_text import parse_json
from ...controllers.validation import require_keys
from ..output.rows import RowFile
from .run import FIELDS, FORMAT, KEY, Ceiling
from .search import Row
from .sequences import Sequence, SequencePolicy
from .settings import CeilingSettings

FILE = "answers.json"


@dataclass(frozen=True)
class Answers:
    """Sequences by scenario id, for the pushes of one suite."""

    suite: Mapping[str, Any]  # its summary
    settings: CeilingSettings  # of the searches
    sequences: Mapping[str, Sequence]

    @classmethod
    def of(cls, found: Ceiling) -> Answers:
        """What has been answered."""
        return cls(found.evaluation.suite.summary(), found.settings, _sequences(found.answered))

    def policy(self, env: Any) -> SequencePolicy:
        """They as a policy for the robot of an environment; where there is none, the planner."""
        biped, s = getattr(env, "unwrapped", env), self.settings
        return SequencePolicy(s.policy, biped.robot, biped.limits, biped.preset, s.scale, self.sequences)

    def save(self, path: Path) -> None:
        """Write them as JSON, an answer a line, whole or not at all."""
        head = {"format": FORMAT, "suite": dict(self.suite), "settings": self.settings.to_dict()}
        entries = {name: [one.period, one.corrections] for name, one in self.sequences.items()}
        body = ",\n".join(f"{json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries.items())
        write_text(path, f'{json.dumps(head)[:-1]}, "answers": {{\n{body}\n}}}}\n')

    @classmethod
    def load(cls, path: Path) -> Answers:
        """Read them from a file.

        Raises:
            InvalidValueError: it cannot be read, or holds no answers of this format.
        """
        what = f"file of answers {str(path)!r}"
        try:
            data = require_keys(
                what, parse_json(what, read_file(path)), {"format", "suite", "settings", "answers"}, set()
            )
        except OSError as error:
            raise InvalidValueError(f"cannot read {what}: {error}") from error
        if data["format"] != FORMAT:
            raise InvalidValueError(f"{what} has format {data['format']!r}, and {FORMAT} is read")
        try:
            sequences = {name: Sequence(*entry) for name, entry in data["answers"].items()}
        except (AttributeError, TypeError, ValueError) as error:
            raise InvalidValueError(f"{what}: {error}") from error
        suite = require_keys(
            f"suite of {what}", data["suite"], {"name", "version", "sha256", "scenarios"}, set()
        )
        return cls(suite, _settings(data["settings"]), sequences)

    @classmethod
    def of_searches(cls, directory: Path) -> Answers:
        """The best attempt at each push in the rows of a directory, whether it has recovered or not.

        Raises:
            InvalidValueError: the directory holds no searches of this format.
        """
        path = directory / "config.json"
        try:
            config = parse_json(repr(str(path)), read_file(path))
        except OSError as error:
            raise InvalidValueError(f"{str(directory)!r} holds no searches: {error}") from error
        known = config if isinstance(config, dict) else {}
        if "ceiling" not in known or known.get("format") != FORMAT:
            raise InvalidValueError(
                f"{str(directory)!r} holds no searches of format {FORMAT}, see config.json"
            )
        rows = RowFile(directory, known, KEY, fields=FIELDS).rows.values()
        tried = [row for row in rows if row["corrections"] is not None]
        return cls(known["suite"], _settings(known["ceiling"]), _sequences(tried))


def load_answers(path: str | Path, env: Any) -> SequencePolicy:
    """The answers of a file or of a directory of searches, replayed by scenario id.

    As a policy of the ordinary rollout and of `evaluate({"ceiling": load_answers(PATH, env)})` it gives the
    outcomes of the searches where code and robot are the same. On a push without a sequence it is the
    planner.

    Args:
        path: `answers.json`, or the directory that it lies in.
        env: environment that it is to act in.

    Raises:
        InvalidValueError: there are no answers of this format.
    """
    place = Path(path)
    return (Answers.of_searches(place) if place.is_dir() else Answers.load(place)).policy(env)


def _sequences(rows: Iterable[Row]) -> dict[str, Sequence]:
    return {row["scenario_id"]: Sequence(row["period"], row["corrections"]) for row in rows}


def _settings(data: object) -> CeilingSettings:
    names = {field.name for field in fields(CeilingSettings)}
    return CeilingSettings(**require_keys("settings of a ceiling", data, names, set()))
