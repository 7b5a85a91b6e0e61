"""`push-recovery suite new`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from ....controllers.errors import InvalidValueError
from ....controllers.json_text import parse_json
from ..options import Count, JsonOption, within

PUSHES_TEXT = (
    "Ranges in place of those of standard or hard, by fields of PushDistribution, such as "
    '\'{"impulse_min": 150, "impulse_max": 180, "push_duration": 0.2}\'.'
)
LIKE_TEXT = (
    "Kind of pushes that is drawn: standard, hard, varied, or one of the shifts (docs/evaluation.md#suites)."
)


@dataclass(frozen=True, kw_only=True)
class SuiteCommand(JsonOption):
    """Write a suite of pushes that nobody has met; --suite FILE of other commands runs it."""

    action: Positional[Literal["new"]]
    """new: draw a suite."""
    like: Annotated[str, arg(metavar="NAME", help=LIKE_TEXT)] = "varied"
    seed: Count = field(metadata=within(0))
    """Seed of the draw; the same seed gives the same suite on every machine."""
    scenarios: Count = field(default=256, metadata=within(1, 65536))
    """Number of scenarios; every whole 256 of them are stratified."""
    name: Annotated[
        str | None, arg(metavar="NAME", help_behavior_hint="(default: the kind and the seed)")
    ] = None
    """Name of the suite."""
    pushes: Annotated[str, arg(metavar="JSON", help=PUSHES_TEXT)] = "{}"
    out: Annotated[str, arg(metavar="FILE")]
    """Suite file to write."""

    def run(self) -> None:
        """Draw and write the suite, and tell its hash."""
        from ...api.drawn_suite import new_suite
        from ...output.place import require_place

        pushes = parse_json("text of --pushes", self.pushes)
        if not isinstance(pushes, dict):
            raise InvalidValueError(f"--pushes must be a JSON object, got {self.pushes!r:.200}")
        suite = new_suite(self.like, self.seed, self.scenarios, self.name, pushes)
        path = Path(self.out)
        require_place(path)
        suite.save(path)
        if self.json:
            self.print_json({**suite.summary(), "out": str(path)})
        else:
            print(f"{path}: suite {suite.name}, {len(suite.scenarios)} pushes, sha256 {suite.sha256}")
