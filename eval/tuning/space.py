"""What is searched: dimensions with bounds and a natural unit, and points in them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError, UnknownNameError

DIGITS = 6  # significant digits of a value: short in a file, far finer than what matters
Settings = dict[str, dict[str, float]]  # group -> field -> value


@dataclass(frozen=True)
class Dimension:
    """One field; a point's coordinate counts units from where the search starts.

    The unit is one standard deviation of the first generation: a factor on the logarithmic scale, a
    difference on the linear one.
    """

    group: str
    name: str
    low: float
    high: float
    unit: float
    scale: Literal["linear", "log"] = "linear"

    @property
    def label(self) -> str:
        """Group and name, as options and tables call it."""
        return f"{self.group}.{self.name}"

    def times(self, factor: float) -> Dimension:
        """The same dimension of a robot whose value is so many times as large; the unit of a factor stays."""
        unit = self.unit if self.scale == "log" else self.unit * factor
        return replace(self, low=self.low * factor, high=self.high * factor, unit=unit)

    def coordinate(self, value: float, start: float) -> float:
        """Units from `start` to `value`."""
        if self.scale == "log":
            return math.log(value / start) / math.log(self.unit)
        return (value - start) / self.unit

    def value(self, coordinate: float, start: float) -> float:
        """Inverse of `coordinate`, within the bounds and rounded to DIGITS."""
        exact = start * self.unit**coordinate if self.scale == "log" else start + self.unit * coordinate
        return float(f"{min(max(exact, self.low), self.high):.{DIGITS}g}")


@dataclass(frozen=True)
class Space:
    """Dimensions and the values at which the search starts, which are the origin."""

    dimensions: tuple[Dimension, ...]
    start: tuple[float, ...]

    def __post_init__(self) -> None:
        for dimension, value in zip(self.dimensions, self.start, strict=True):
            if not dimension.low <= value <= dimension.high:
                raise InvalidValueError(
                    f"{dimension.label} must start in [{dimension.low:g}, {dimension.high:g}], got {value:g}"
                )

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Least and greatest coordinates, (n, 2)."""
        pairs = zip(self.dimensions, self.start, strict=True)
        return np.array([[d.coordinate(d.low, s), d.coordinate(d.high, s)] for d, s in pairs])

    def settings(self, point: Sequence[float] | NDArray[np.float64]) -> Settings:
        """The values of a point (n,), by group."""
        out: Settings = {}
        for dimension, start, coordinate in zip(self.dimensions, self.start, point, strict=True):
            out.setdefault(dimension.group, {})[dimension.name] = dimension.value(float(coordinate), start)
        return out

    def point(self, settings: Mapping[str, Mapping[str, float]]) -> NDArray[np.float64]:
        """Inverse of `settings`, (n,)."""
        pairs = zip(self.dimensions, self.start, strict=True)
        return np.array([d.coordinate(settings[d.group][d.name], s) for d, s in pairs])

    def to_dict(self) -> dict[str, dict[str, float | str]]:
        """Label -> start, bounds, unit and scale."""
        return {
            d.label: {"start": s, "low": d.low, "high": d.high, "unit": d.unit, "scale": d.scale}
            for d, s in zip(self.dimensions, self.start, strict=True)
        }


def make_space(dimensions: Iterable[Dimension], start: Mapping[str, Mapping[str, float]]) -> Space:
    """A space that starts at some settings."""
    dimensions = tuple(dimensions)
    return Space(dimensions, tuple(float(start[d.group][d.name]) for d in dimensions))


def select(dimensions: Sequence[Dimension], only: Sequence[str]) -> tuple[Dimension, ...]:
    """The dimensions whose label or group is named; all of them where nothing is.

    Raises:
        UnknownNameError: a name that fits none.
    """
    labels = [dimension.label for dimension in dimensions]
    groups = sorted({dimension.group for dimension in dimensions})
    for name in only:
        if name not in labels and name not in groups:
            raise UnknownNameError("field to tune", name, [*groups, *labels])
    return tuple(d for d in dimensions if not only or d.label in only or d.group in only)
