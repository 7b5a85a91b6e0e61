"""The largest push that a variant survives in one direction: one job, one row."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, ClassVar

from ....controllers.model.capturability import max_recoverable_force, max_recoverable_impulse
from ....envs.scenario.push import GaitEvent, polar_push
from ....envs.scenario.scenario import Command, Scenario
from ...frontier.grid import BEYOND, NOMINAL_STEPS, Scanned, multiples, scan_upwards
from .batch import run_batch
from .variants import Variant, built

CHUNK = 640.0  # range of forces that are tried side by side; changes no number [N]
JUMP_TIME = 1e-4  # a push this short stands for a velocity jump: 0.02 % less shift of the DCM [s]
PUSH_TIME = 0.1  # the paper's [s]
Survives = Callable[[Sequence[float]], Sequence[bool]]


@dataclass(frozen=True)
class PushKind:
    """The push that is scanned: towards psi, at the start of a left stance after four nominal steps."""

    psi_deg: float  # counter-clockwise from forward [deg]
    duration: float = PUSH_TIME  # [s]; 0: a velocity jump, whose strength is an impulse [N s]
    vx: float = 0.0  # commanded [m/s]

    @property
    def unit(self) -> str:
        """Of the strength."""
        return "N" if self.duration > 0 else "N s"

    @property
    def unit_strength(self) -> float:
        """Strength that counts as one newton for 0.1 s."""
        return 1.0 if self.duration > 0 else PUSH_TIME

    def scenario(self, strength: float, seed: int = 0) -> Scenario:
        """The push with a strength [unit]; `seed` is that of the measurement's noise."""
        force, duration = strength, self.duration
        if duration == 0:
            force, duration = strength / JUMP_TIME, JUMP_TIME
        event = GaitEvent(NOMINAL_STEPS, "left", 0.0)
        push = polar_push(force, math.radians(self.psi_deg), duration, event)
        name = f"{self.psi_deg:g}deg-{strength:g}{self.unit.replace(' ', '')}"
        return Scenario(name, (push,), Command(self.vx), "left", noise_seed=seed)

    def limit(self, variant: Variant, **options: Any) -> float:
        """The closed form's largest strength for the variant's robot and gait; options as for the force."""
        robot, gait, psi = variant.robot_model, variant.gait(self.vx), math.radians(self.psi_deg)
        if self.duration > 0:
            return max_recoverable_force(robot, psi, self.duration, gait=gait, **options)
        return max_recoverable_impulse(robot, psi, gait=gait, **options)

    def identity(self) -> dict[str, Any]:
        """As JSON."""
        return {"psi_deg": self.psi_deg, "duration": self.duration, "vx": self.vx}


@dataclass(frozen=True)
class ScanJob:
    """Scan one direction of one variant.

    `grids` go from coarse to fine, in newtons for 0.1 s. The coarse one is scanned from its first multiple to
    BEYOND past the first failure; every finer one fills the interval that ends at the first failure so far.
    """

    FIELDS: ClassVar[tuple[str, ...]] = ("unit", "survived", "largest_survived", "failed")
    variant: Variant
    push: PushKind
    grids: tuple[float, ...] = (5.0, 1.0)
    seeds: tuple[int, ...] = (0,)  # of noise; a strength counts as survived where all of them are

    def identity(self) -> dict[str, Any]:
        """All that decides the row, as JSON."""
        return {
            "kind": "scan",
            **self.push.identity(),
            "grids": list(self.grids),
            "seeds": list(self.seeds),
            "variant": self.variant.identity(),
        }

    @property
    def text(self) -> str:
        """For the progress bar."""
        return f"{self.variant.label}, {self.push.psi_deg:g} deg"

    def run(self) -> dict[str, Any]:
        """Scan; strengths in the unit of the push."""
        unit = self.push.unit_strength
        found = scan(self._survives, self.grids, unit)
        return {"unit": self.push.unit, **found}

    def _survives(self, strengths: Sequence[float]) -> list[bool]:
        policy, plant = built(self.variant)
        scenarios = [self.push.scenario(strength, seed) for strength in strengths for seed in self.seeds]
        endings = run_batch(policy, scenarios, plant, self.variant.measurement)
        n = len(self.seeds)
        return [all(e.survived for e in endings[n * k : n * (k + 1)]) for k in range(len(strengths))]


@dataclass(frozen=True)
class EpisodeJob:
    """One push of one variant."""

    FIELDS: ClassVar[tuple[str, ...]] = (
        "survived", "recovered", "recovered_at", "failure_reason", "end_time",
    )  # fmt: skip
    kind: ClassVar[str] = "episode"  # of the row
    variant: Variant
    push: PushKind
    strength: float

    def identity(self) -> dict[str, Any]:
        """All that decides the row, as JSON."""
        about = {**self.push.identity(), "strength": self.strength}
        return {"kind": self.kind, **about, "variant": self.variant.identity()}

    @property
    def text(self) -> str:
        """For the progress bar."""
        return f"{self.variant.label}, {self.strength:g} {self.push.unit}"

    def run(self) -> dict[str, Any]:
        """Run it."""
        policy, plant = built(self.variant)
        scenario = self.push.scenario(self.strength)
        ending = run_batch(policy, [scenario], plant, self.variant.measurement)[0]
        return {
            "survived": ending.survived,
            "recovered": ending.recovered,
            "recovered_at": ending.recovered_at,
            "failure_reason": ending.failure_reason,
            "end_time": ending.end_time,
        }


def scan(survives: Survives, grids: Sequence[float], unit: float = 1.0) -> dict[str, Any]:
    """Largest strength before the first failure, the largest survived at all, and what failed.

    Args:
        survives: whether each of several strengths is survived.
        grids: coarse to fine, in units of `unit`.
        unit: of grids, BEYOND and the cap.
    """
    outcome = scan_upwards(
        lambda wanted: _in_chunks(survives, wanted, max(1, round(CHUNK / grids[0]))),
        (round(force * unit, 9) for force in multiples(grids[0])),
        BEYOND * unit,
        bool,
    )
    for grid in grids[1:]:
        first = min((s for s, ok in outcome.items() if not ok), default=None)
        if first is None:
            break
        below = max((s for s, ok in outcome.items() if ok and s < first), default=0.0)
        count = math.ceil((first - below) / (grid * unit) - 1e-9)
        between = [round(below + k * grid * unit, 9) for k in range(1, count)]
        outcome.update(zip(between, survives(between), strict=True) if between else ())
    found = Scanned.of(outcome)
    return {
        "survived": found.survived,
        "largest_survived": found.largest_survived,
        "failed": list(found.failed),
    }


def _in_chunks(survives: Survives, strengths: Iterator[float], count: int) -> Iterator[tuple[float, bool]]:
    """Whether strengths are survived, `count` of them side by side."""
    while chunk := list(islice(strengths, count)):
        yield from zip(chunk, survives(chunk), strict=True)
