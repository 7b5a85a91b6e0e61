"""Where the entries of MuJoCo's fields go in the arrays that a controller reads and writes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import mujoco
import numpy as np

ONE = -1  # in place of an entry of MuJoCo's: the number 1


class Run(NamedTuple):
    """Entries that lie in a row on both sides."""

    to: int  # first entry in the array of one robot
    source: int  # first entry in MuJoCo's field, or ONE
    entries: int


class Field(NamedTuple):
    """A field of MjData (float64) and the runs of it that are copied; the rest of the array stays 0."""

    name: str
    shape: tuple[int, ...]  # of the array of one robot
    runs: tuple[Run, ...]


def whole(data: mujoco.MjData, name: str) -> Field:
    """The field as it is."""
    shape = getattr(data, name).shape
    return Field(name, shape, (Run(0, 0, int(np.prod(shape))),))


def picked(name: str, shape: tuple[int, ...], pairs: Iterable[tuple[int, int]]) -> Field:
    """Some entries of a field, as (entry in the array, entry in the field); what lies in a row is one run."""
    runs: list[Run] = []
    for to, source in pairs:
        last = runs[-1] if runs else Run(0, 0, 0)
        follows = (to, source) == (last.to + last.entries, last.source + last.entries)
        if runs and follows and ONE not in {source, last.source}:
            runs[-1] = last._replace(entries=last.entries + 1)
        else:
            runs.append(Run(to, source, 1))
    return Field(name, shape, tuple(runs))


def rows(name: str, count: int, width: int, pairs: Iterable[tuple[int, int]]) -> Field:
    """Some rows of a field (m, width), as (row in the array, row in the field); an array (count, width)."""
    entries = ((to * width + i, source * width + i) for to, source in pairs for i in range(width))
    return picked(name, (count, width), entries)
