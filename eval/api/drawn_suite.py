"""A suite of one's own, drawn from a seed: pushes of a known kind that nobody has met."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.validation import require_choice, require_integer, require_keys
from ...envs.scenario.push_distribution import PushDistribution
from ..score.shifts import HARD, SHIFTS, shifted_scenarios
from ..score.stratified import BLOCK, pelvis_scenarios
from ..score.suites import Suite
from ..score.varied import varied_scenarios

RANGES: Mapping[str, PushDistribution] = MappingProxyType({"standard": PushDistribution(), "hard": HARD})
KINDS = (*RANGES, "varied", *SHIFTS)
LARGEST = 65536  # scenarios
# Fields of a distribution that these suites do not draw: one push all round at the pelvis, of one duration
UNUSED = {
    "direction_min", "direction_max", "errors", "turn", "bodies", "push_duration_ratio", "pushes_max",
}  # fmt: skip


def new_suite(
    like: str = "varied",
    seed: int = 0,
    scenarios: int = BLOCK,
    name: str | None = None,
    pushes: Mapping[str, Any] | None = None,
) -> Suite:
    """A suite drawn like a named one, from another seed; the same arguments give the same suite.

    Args:
        like: one of KINDS.
        seed: of the draw.
        scenarios: how many; every whole 256 of them are stratified.
        name: of the suite; by default that of the kind and the seed.
        pushes: other ranges than those of the kind, by fields of `PushDistribution`; of standard and hard.

    Raises:
        UnknownNameError: another kind, or a field that is none.
        InvalidValueError: a number out of its bounds, an impossible range or name, or ranges of a kind that
            has others.
    """
    require_choice("kind of suite", like, KINDS)
    require_integer("seed", seed)
    require_integer("scenarios", scenarios, 1, LARGEST)
    label, blocks = name or f"{like}-{seed}", math.ceil(scenarios / BLOCK)
    if like in RANGES:
        drawn = pelvis_scenarios(label, _ranges(like, pushes or {}), blocks, seed)
    elif pushes:
        raise InvalidValueError(
            f"only {' and '.join(RANGES)} take other ranges of pushes, not {like!r}: got {dict(pushes)}"
        )
    elif like in SHIFTS:
        drawn = shifted_scenarios(like, label, blocks, seed)
    else:
        drawn = varied_scenarios(label, blocks, seed)
    return Suite(label, "1", drawn[:scenarios])


def _ranges(like: str, pushes: Mapping[str, Any]) -> PushDistribution:
    """The ranges of a kind, with other values of some fields."""
    known = RANGES[like].to_dict()
    given = require_keys("ranges of pushes", dict(pushes), set(), set(known) - UNUSED)
    return PushDistribution.from_dict({**known, **given})
