"""The rows of one robot in the arrays of n: found from the annotations that compiled code reads them by.

An array that is added to a part of an address table is a robot's state unless it is said to be something
else, so that none can be forgotten.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.array_table import field_kinds

Arrays = dict[str, NDArray[Any]]  # by PART.FIELD
Rows = Mapping[str, NDArray[Any]]


def arrays_of(parts: Any, left_out: Collection[str]) -> Arrays:
    """Arrays of a NamedTuple of parts, under PART.FIELD.

    Args:
        parts: what `parts_table` takes, as a NamedTuple.
        left_out: names of whole parts, and of single arrays as PART.FIELD.
    """
    found: Arrays = {}
    for name, part in zip(parts._fields, parts, strict=True):
        if name in left_out:
            continue
        for field, kind, value in zip(part._fields, field_kinds(type(part)), part, strict=True):
            if kind is not None and f"{name}.{field}" not in left_out:
                found[f"{name}.{field}"] = value
    return found


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
