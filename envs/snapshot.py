"""A robot between two planning periods, as rows of arrays that can be put back.

Which rows are its state follows from the annotations that compiled code reads the arrays by: an array that is
added to a part of an address table is a robot's state unless it is annotated as something else, so that none
can be forgotten.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, get_type_hints

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..controllers.array_table import array_fields
from ..controllers.errors import InvalidValueError
from ..controllers.model.gait_box import DURATION
from .scenario.arrays import DUE
from .scenario.push import GaitEvent, Push, Side
from .scenario.scenario import Scenario

Arrays = dict[str, NDArray[Any]]  # by PART.FIELD
Rows = Mapping[str, NDArray[Any]]


def arrays_of(parts: Any, left_out: Collection[str], only: str = "") -> Arrays:
    """Arrays of a NamedTuple of parts, under PART.FIELD.

    Args:
        parts: what `parts_table` takes, as a NamedTuple.
        left_out: which ones are not taken, by what the annotation of part or field says, as COMMON.
        only: where given, only those of which it says that.
    """
    return {
        f"{part}.{field}": getattr(getattr(parts, part), field)
        for part, field, notes in _fields(type(parts))
        if not notes & set(left_out) and (not only or only in notes)
    }


@cache
def _fields(parts: type) -> list[tuple[str, str, set[str]]]:
    """(part, field, what the annotations of both say of it) of all arrays of a NamedTuple of parts."""
    said = get_type_hints(parts, include_extras=True)
    return [
        (name, field, {*getattr(said[name], "__metadata__", ()), *notes})
        for name, part in get_type_hints(parts).items()
        for field, (_, *notes) in array_fields(part).items()
    ]


def take_rows(arrays: Arrays, k: int, n: int) -> Arrays:
    """Copies of row k of arrays that have one a robot; they cannot be written.

    Raises:
        TypeError: an array has another length than n: it is common to all robots, and has to be left out.
    """
    if wrong := [name for name, array in arrays.items() if len(array) != n]:
        raise TypeError(f"these arrays do not have a row for each of {n} robots: {', '.join(wrong)}")
    rows = {name: np.array(array[k]) for name, array in arrays.items()}
    for row in rows.values():
        row.flags.writeable = False
    return rows


# Fields of the walk so far
SAME = ("command", "stance_side", "noise_seed", "errors", "physics", "sensing", "jumps", "start", "stride")
START, NEXT_CHANGE = "pushes.start", "schedule.next"
STEPS, ELAPSED, PLAN = "gait.steps", "gait.elapsed", "gait.plan"


@dataclass(frozen=True, eq=False)
class RobotSnapshot:
    """The whole state of one robot, as it was between two planning periods; it can be pickled.

    What comes of it is the same bit for bit in every place of every environment of the same kind. What a
    policy remembers, and the generator that later scenarios are drawn with, are not the robot's.
    """

    scenario: Scenario  # that it is in
    time: float  # since reset [s]
    made_for: Mapping[str, str]  # what the environment was: what, and which
    rows: Rows  # of all its arrays, by PART.FIELD

    def check_made_for(self, here: Mapping[str, str]) -> None:
        """Raise InvalidValueError where it was taken of another kind of robot than lives `here`."""
        for what, which in here.items():
            if self.made_for.get(what) != which:
                raise InvalidValueError(
                    f"the snapshot was taken of another {what}, {self.made_for.get(what, 'none')!r}, than "
                    f"this environment has, {which!r}"
                )

    def check_scenario(self, scenario: Scenario) -> list[int]:
        """Which pushes of a scenario that goes on from here are those of the snapshot's own.

        Another scenario may have other pushes that have not begun, another id, another end, and other changes
        of the command to come.

        Raises:
            InvalidValueError: it differs in what has happened already.
        """
        for name in SAME:
            then, asked = getattr(self.scenario, name), getattr(scenario, name)
            if asked != then:
                raise InvalidValueError(
                    f"a scenario that goes on from a snapshot must have its {name}, {then!r}, got {asked!r}"
                )
        if scenario.floor_goes != self.scenario.floor_goes:
            raise InvalidValueError(
                "a scenario that goes on from a snapshot must have a floor that moves if, and only if, the "
                "snapshot's own has"
            )
        due = self.rows[NEXT_CHANGE].item()
        later = scenario.changes[due:]
        if scenario.changes[:due] != self.scenario.changes[:due] or (later and later[0].time <= self.time):
            raise InvalidValueError(
                "a scenario that goes on from a snapshot must have the changes of command that came before "
                f"{self.time:g} s, {self.scenario.changes[:due]!r}, and no other, got {scenario.changes!r}"
            )
        return self._check_pushes(scenario)

    def _check_pushes(self, scenario: Scenario) -> list[int]:
        own, asked = self.scenario.forces, scenario.forces
        kept = [i for i, push in enumerate(asked) if i < len(own) and push == own[i]]
        for i, push in enumerate(own):
            if i not in kept and self.rows[START][i] < self.time:
                raise InvalidValueError(
                    f"push {i} of the snapshot began at {self.rows[START][i]:g} s, before it was taken at "
                    f"{self.time:g} s: a scenario that goes on from it must have the same one, {push!r}"
                )
        for i, push in enumerate(asked):
            if i not in kept and self._is_over(push, scenario.stance_side):
                raise InvalidValueError(
                    f"push {i} would begin before the snapshot was taken, at {self.time:g} s in step "
                    f"{self.rows[STEPS].item()}: {push!r}"
                )
        return kept

    def _is_over(self, push: Push, first_side: Side) -> bool:
        """Whether the beginning of a push has gone by.

        A physics step has the floor that the one before it has left, so that no floor changes at once.
        """
        start, at_once = push.start, push.law is not None and push.law.moves_floor
        if not isinstance(start, GaitEvent):
            return start < self.time or (at_once and start < self.time + DUE)
        behind = self.rows[STEPS].item() - start.step_index(first_side)
        planned = self.rows[PLAN][DURATION].item()
        return behind > 0 or (behind == 0 and self.rows[ELAPSED].item() > start.fraction * planned)


def digest_of(*contents: bytes) -> str:
    """A short name of contents."""
    return hashlib.sha256(b"\0".join(contents)).hexdigest()[:12]


@lru_cache(maxsize=16)
def model_digest(model: mujoco.MjModel) -> str:
    """A short name of a compiled model's content."""
    content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return digest_of(content.tobytes())
