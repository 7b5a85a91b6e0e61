"""The force up to which a share of replicas recovers: their draw, the search, and the interval.

One trajectory says little: another phase of the step, a start a millimetre aside or another noise, and the
largest force survived is another one, at times an island of resonance. So each force is tried on N replicas
that differ in the three, and the same N for every force, direction and policy (common random numbers).

With y_i(F) = 1 where replica i recovers from F, p(F) is the smallest share mean y_i(F') of all F' up to F
that were tried, unpushed replicas first, and linear between them: so a threshold does not lie beyond a hole,
however many recover from harder pushes. The threshold is where p comes down to 0.8. J50 and J95 are the
impulses at which it is 0.5 and 0.95.

Replica i begins its push in the i-th of N equal parts of the step. Such a stratified sample tells the share
better than N phases at random do: as well as N_e = N / d of those would, with the design effect

    d = (1 + sum of (y_i - y_(i-1))^2) / (2 (N - 1)) / (p (1 - p))

of neighbours in phase (Wolter 2007, Introduction to Variance Estimation, ch. 8), with one more change than
was seen, since few are. Both sums go over the forces tried, of which those count most where p is near the
share looked for. The 95 % interval of a force holds all at which Wilson's score interval of p, of N_e
replicas, holds the share; the tests show how often it holds the truth.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...controllers.validation import require_integer
from ...envs.scenario.scenario import StartOffset
from ..output.statistics import Z
from .draw import uniforms

BEYOND = 100.0  # how far past the first failure a direction is scanned [N]
FORCE_CAP = 4000.0  # no scan goes further [N]
MOST_DIRECTIONS = 3600
TOLERANCE = 1e-9  # of strengths that are multiples of a grid
T = TypeVar("T")
Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Scanned:
    """Result of a scan, in the unit of its strengths."""

    survived: float  # largest before the first failure; 0 where none was survived
    largest_survived: float  # at all
    failed: tuple[float, ...]  # rising

    @classmethod
    def of(cls, survives: Mapping[float, bool]) -> Self:
        """From whether each strength was survived."""
        failed = tuple(sorted(strength for strength, ok in survives.items() if not ok))
        survived = [strength for strength, ok in survives.items() if ok]
        before = [strength for strength in survived if not failed or strength < failed[0]]
        return cls(max(before, default=0.0), max(survived, default=0.0), failed)


def scan_upwards(
    run: Callable[[Iterator[float]], Iterable[tuple[float, T]]],
    strengths: Iterable[float],
    beyond: float,
    survived: Callable[[T], bool],
) -> dict[float, T]:
    """Outcomes of rising strengths up to `beyond` past the first failure, in rising order.

    Several may run at once, so that a weaker one fails late; what was tried past the end that it sets is left
    out. So what comes out does not depend on how many run at once.

    Args:
        run: takes strengths when it has room for them; gives (strength, outcome) in any order.
        strengths: rising.
        beyond: in their unit.
        survived: whether an outcome counts as survived.
    """
    end, found = float("inf"), {}

    def wanted() -> Iterator[float]:
        for strength in strengths:
            if strength > end + TOLERANCE:
                return
            yield strength

    for strength, outcome in run(wanted()):
        found[strength] = outcome
        if not survived(outcome):
            end = min(end, strength + beyond)
    return {strength: found[strength] for strength in sorted(found) if strength <= end + TOLERANCE}


def multiples(grid: float) -> Iterator[float]:
    """The multiples of a grid [N] from the first up to FORCE_CAP."""
    return (k * grid for k in range(1, int(FORCE_CAP / grid + TOLERANCE) + 1))


def directions_deg(count: int) -> list[float]:
    """`count` directions counter-clockwise from forward [deg].

    Raises:
        InvalidValueError: fewer than one, or more than MOST_DIRECTIONS.
    """
    require_integer("directions", count, 1, MOST_DIRECTIONS)
    return [360.0 * k / count for k in range(count)]


MOST_REPLICAS = 4096
SHIFT, LEAN = 1e-3, math.radians(1.0)  # of the start, at most, on each axis and to either side [m], [rad]


@dataclass(frozen=True)
class Replica:
    """What differs from one replica to the next."""

    phase: float  # of the step when the push begins, as a share of its planned duration, in [0, 1)
    start: StartOffset
    noise_seed: int


def draw_replicas(count: int, seed: int) -> tuple[Replica, ...]:
    """`count` replicas in rising phase, a function of both arguments alone.

    Each of the five coordinates is uniform, one replica in each of `count` equal parts of its range (Latin
    hypercube, McKay et al. 1979).
    """
    require_integer("replicas", count, 1, MOST_REPLICAS)
    require_integer("replica_seed", seed)
    generator = np.random.PCG64(np.random.SeedSequence((seed, count)))
    order = np.argsort(uniforms(generator, 5, count), axis=1)
    order[0] = np.arange(count)  # of the phases
    phase, *off = (order + uniforms(generator, 5, count)) / count
    seeds = generator.random_raw(count) >> 33
    x, y, forward, left = (2.0 * one - 1.0 for one in off)
    return tuple(
        Replica(
            float(phase[i]),
            StartOffset((SHIFT * x[i], SHIFT * y[i]), (LEAN * forward[i], LEAN * left[i])),
            int(seeds[i]),
        )
        for i in range(count)
    )


RECOVERED_SHARE = 0.8  # of the replicas, at the threshold
SHARES = (0.95, RECOVERED_SHARE, 0.5)  # at J95, the threshold and J50
FIRST = 16  # cells of the grid in the first force that is tried
NEAR = 0.1  # two shares this far apart tell half as much of one another, about


def force_at(forces: Array, shares: Array, share: float) -> Array:
    """Largest force (...) up to which falling shares (..., L) at forces (L,) are at least `share` [N].

    Linear between the forces; 0 where not even the first has it, the last where all of them do.
    """
    enough = np.count_nonzero(shares >= share, axis=-1)
    above, below = np.maximum(enough - 1, 0), np.minimum(enough, forces.size - 1)
    high, low = (np.take_along_axis(shares, at[..., None], -1)[..., 0] for at in (above, below))
    drop = np.where(high > low, high - low, 1.0)
    along = np.where(above < below, (high - share) / drop, 0.0)
    found = forces[above] + along * (forces[below] - forces[above])
    return np.where(enough > 0, found, 0.0)


def score_band(shares: Array, replicas: float) -> tuple[Array, Array]:
    """Wilson's 95 % score interval of each share among so many replicas, which need not be a whole number."""
    square = Z**2 / replicas
    middle, half = shares + 0.5 * square, np.sqrt(square * (shares * (1.0 - shares) + 0.25 * square))
    return (middle - half) / (1.0 + square), (middle + half) / (1.0 + square)


class Estimate(NamedTuple):
    """A force and its 95 % interval [N]; an end at the largest force tried means that or more."""

    force: float
    low: float
    high: float


@dataclass(frozen=True)
class Tried:
    """Outcomes of replicas at rising forces, of which the first is 0."""

    forces: Array  # (L,) [N]
    recovered: Bools  # (L, N)

    @classmethod
    def of(cls, outcomes: Mapping[float, Bools]) -> Self:
        """From outcomes by force; where 0 N is missing, all recover unpushed."""
        found = dict(outcomes)
        if 0.0 not in found:
            found[0.0] = np.ones_like(next(iter(found.values())))
        rising = sorted(found)
        return cls(np.array(rising), np.array([found[force] for force in rising]))

    @property
    def shares(self) -> Array:
        """The smallest share of replicas that recovers from any force up to this one, (L,)."""
        return np.minimum.accumulate(self.recovered.mean(axis=1))

    def estimates(self, shares: Iterable[float] = SHARES) -> list[Estimate]:
        """Forces up to which at least these shares recover."""
        found = []
        for share in shares:
            bounds = self.shares, *score_band(self.shares, self.effective_replicas(share))
            found.append(Estimate(*(float(force_at(self.forces, one, share)) for one in bounds)))
        return found

    def effective_replicas(self, share: float) -> float:
        """N_e near a share, at least N."""
        count, mean = self.recovered.shape[1], self.recovered.mean(axis=1)
        mixed, spread = (mean > 0.0) & (mean < 1.0), mean * (1.0 - mean)
        near = np.exp(-np.abs(self.shares - share) / NEAR) * mixed
        changes = np.count_nonzero(np.diff(self.recovered, axis=1), axis=1)
        if not mixed.any():
            return float(count)
        effect = near @ (1.0 + changes) / (2.0 * (count - 1)) / (near @ spread)
        return count / min(effect, 1.0)

    @property
    def first_failure(self) -> float | None:
        """The weakest force at which not every replica recovers [N]."""
        failed = self.forces[~self.recovered.all(axis=1)]
        return float(failed[0]) if failed.size else None

    @property
    def islands(self) -> dict[float, int]:
        """Force [N] -> how many replicas recover there that do not from a weaker one."""
        failed = np.logical_or.accumulate(~self.recovered, axis=0)
        count = (failed & self.recovered).sum(axis=1)
        return {float(force): int(n) for force, n in zip(self.forces, count, strict=True) if n}


def coarse_forces(grid: float) -> Iterator[float]:
    """Forces of FIRST cells, 1.5, 2, 3, 4, 6, ... times as many, and last the largest up to FORCE_CAP [N]."""
    most = int(FORCE_CAP / grid + TOLERANCE)
    cells = FIRST
    while cells < most:
        yield cells * grid
        cells += cells // 2 if cells & (cells - 1) == 0 else cells // 3
    yield most * grid


Wanted = Sequence[tuple[Bools, tuple[float, ...]]]  # outcomes of replicas, and the shares looked for in them


def bools(values: Iterable[bool]) -> Bools:
    """Outcomes as an array (N,)."""
    return np.fromiter(values, np.bool_)


def search(run: Callable[[float], T], wanted: Callable[[T], Wanted], grid: float) -> dict[float, T]:
    """Outcomes of the forces of a grid [N] that are needed to find some shares to one cell, in rising order.

    `coarse_forces` are tried until fewer recover than the least share, and those up to BEYOND more; then each
    interval in which p comes down to one of the shares is halved until it is one cell. One
    force is tried at a time, so what comes out depends on the outcomes alone.

    Args:
        run: tries a force on all replicas.
        wanted: of its outcome the series of replicas, those that count for the scan first, with their shares.
        grid: [N].
    """

    def enough(outcome: T) -> bool:
        yes, shares = wanted(outcome)[0]
        return float(yes.mean()) >= min(shares)

    found = scan_upwards(
        lambda forces: ((force, run(force)) for force in forces),
        coarse_forces(grid),
        BEYOND,
        enough,
    )
    while (force := _next_force({force: wanted(one) for force, one in found.items()}, grid)) is not None:
        found[force] = run(force)
    return {force: found[force] for force in sorted(found)}


def _next_force(found: Mapping[float, Wanted], grid: float) -> float | None:
    """The middle of the first interval over one cell that one of the shares lies in, on the grid [N]."""
    for number, (_, shares) in enumerate(next(iter(found.values()))):
        tried = Tried.of({force: series[number][0] for force, series in found.items()})
        cells, falling = np.round(tried.forces / grid).astype(int), tried.shares
        for share in shares:
            enough = np.count_nonzero(falling >= share)
            if 0 < enough < cells.size and cells[enough] - cells[enough - 1] > 1:
                return float((cells[enough] + cells[enough - 1]) // 2 * grid)
    return None
