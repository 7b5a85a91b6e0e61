"""Stored answers as a policy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.json_text import parse_json
from ...controllers.validation import require_keys
from ..output.rows import RowFile
from .run import FIELDS, FORMAT, KEY
from .sequences import Sequence, SequencePolicy
from .settings import CeilingSettings


def load_answers(directory: str | Path, env: Any) -> SequencePolicy:
    """The sequences that searches left in a directory, replayed by scenario id.

    On a push without one it is the planner that was corrected. It is one policy for the rollout of one robot
    after the other, as `evaluate({"ceiling": load_answers(DIR, env)})` does; the outcomes are those of the
    searches where code and robot are.

    Args:
        directory: `ceiling` below that of the evaluation.
        env: environment that it is to act in.

    Raises:
        InvalidValueError: the directory holds no searches, or of another format.
    """
    place, biped = Path(directory), getattr(env, "unwrapped", env)
    try:
        config = parse_json(f"{str(place / 'config.json')!r}", (place / "config.json").read_bytes())
    except OSError as error:
        raise InvalidValueError(f"{str(place)!r} holds no searches: {error}") from error
    known = config if isinstance(config, dict) else {}
    if "ceiling" not in known or known.get("format") != FORMAT:
        raise InvalidValueError(f"{str(place)!r} holds no searches of format {FORMAT}: see its config.json")
    fields = set(CeilingSettings.__dataclass_fields__)
    settings = CeilingSettings(**require_keys("settings of a ceiling", known["ceiling"], fields, set()))
    rows = RowFile(place, known, KEY, fields=FIELDS).rows.values()
    sequences = {
        row["scenario_id"]: Sequence(row["period"], row["corrections"])
        for row in rows if row["corrections"] is not None
    }  # fmt: skip
    return SequencePolicy(settings.policy, biped.robot, biped.limits, biped.preset, settings.scale, sequences)
