"""Corrections of a residual by direction of the push: collected, as tables, as a figure."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from ...controllers.errors import InvalidValueError
from ...controllers.model import gait_box, observation
from ...controllers.policies.learned import NetworkPolicy
from ...envs.scenario.scenario import Scenario
from ..output.tables import markdown_table
from ..rollout.episodes import rollout
from .record import Array, EpisodeRecord, RecordedPolicy, record_episode
from .style import POLICY_STYLES, new_figure, print_style, save
from .words import sector_of

STEPS = 3  # that are looked at: the one that is pushed in, and those after it


@dataclass(frozen=True, eq=False)
class PushCorrections:
    """One pushed episode under a residual."""

    scenario_id: str
    psi: float  # direction of the push in the canonical frame of its begin, 90 outward [deg]
    impulse: float  # horizontal [N s]
    below_recovered: bool  # without the residual
    recovered: bool
    corrections: Array  # (STEPS, 7) mean over each step from the push on, gait variables; NaN: no such step


def collect(env: gym.Env, policy: Any, scenarios: Sequence[Scenario]) -> Iterator[PushCorrections]:
    """Run every scenario, of whose pushes the first counts, with the residual and without it.

    Raises:
        InvalidValueError: the policy is no residual on gait actions, or a scenario has no push.
    """
    if bare := [scenario.id for scenario in scenarios if not scenario.pushes]:
        raise InvalidValueError(f"corrections are shown by the direction of a push; {bare[0]!r} has none")
    rule = policy.rule if isinstance(policy, NetworkPolicy) else None
    if rule is None:
        raise InvalidValueError("only a residual on gait actions has corrections to look at")
    limits = policy.description.limits
    for scenario in scenarios:
        recorded = RecordedPolicy(policy)
        episode = record_episode(env, recorded, scenario, "residual")
        base = rule.below(np.array(recorded.observations)).base
        added = limits.from_action(np.array(recorded.actions)) - limits.from_action(base)
        below = rollout(env, rule.policy, scenario, "below")
        yield corrections_of(episode, added, below.recovered)


def corrections_of(episode: EpisodeRecord, added: Array, below_recovered: bool) -> PushCorrections:
    """Corrections from the first push on; `added` (n, 7) are gait variables less those of the base."""
    n = len(added)
    time, step = episode["time"][:n], episode["step"][:n]
    pushed = int(np.searchsorted(time, episode.push_starts[0], side="right")) - 1
    means = np.full((STEPS, gait_box.GAIT_SIZE), np.nan)
    for k in range(STEPS):
        of_step = (np.arange(n) >= pushed) & (step == step[pushed] + k)
        if of_step.any():
            means[k] = added[of_step].mean(axis=0)
    push = episode.scenario.pushes[0]
    turned = push.direction - (0.0 if push.frame == "heading" else episode["heading"][pushed])
    outward = observation.side_sign(int(episode["stance_side"][pushed])) * turned
    return PushCorrections(
        episode.scenario.id,
        math.degrees(math.remainder(outward, math.tau)),
        math.hypot(*push.force[:2]) * push.duration,
        below_recovered,
        episode.outcome.recovered,
        means,
    )


SECTORS = ("forward", "forward outward", "outward", "backward outward",
           "backward", "backward inward", "inward", "forward inward")  # fmt: skip
UNITS = (("mm", 1e3),) * 2 + (("ms", 1e3),) + (("mm", 1e3),) * 2 + (("rad/s^2", 1.0),) * 2
SHOWN = tuple(
    f"{name.replace('_', ' ')} [{unit}]" for name, (unit, _) in zip(gait_box.GAIT_NAMES, UNITS, strict=True)
)
STEP_NAMES = ("the step that is pushed in", "the next step", "the one after")


@dataclass(frozen=True, eq=False)
class Summary:
    """Counts and mean corrections of many pushes, by sector of 45 degrees about the directions of SECTORS."""

    pushes: Array  # (8,)
    repaired: Array  # (8,) recovered only with the residual
    lost: Array  # (8,) recovered only without it
    left: Array  # (8,) recovered by neither
    mean: Array  # (STEPS, 8, 7) of the corrections [UNITS]; NaN where there is none
    spread: Array  # (STEPS, 8, 7) standard deviation over pushes


def summarise(found: Sequence[PushCorrections]) -> Summary:
    """Count, and take means over pushes."""
    sectors = np.array([sector_of(one.psi) for one in found], dtype=np.int64)
    below, with_it = (
        np.array([getattr(one, name) for one in found], dtype=np.bool_)
        for name in ("below_recovered", "recovered")
    )
    scaled = np.array([one.corrections for one in found]) * [factor for _, factor in UNITS]
    shape = (STEPS, len(SECTORS), len(gait_box.GAIT_NAMES))
    mean, spread = np.full(shape, np.nan), np.full(shape, np.nan)
    for sector in range(len(SECTORS)):
        for step in range(STEPS):
            values = scaled[sectors == sector, step]
            values = values[np.isfinite(values[:, 0])]
            if len(values):
                mean[step, sector], spread[step, sector] = values.mean(axis=0), values.std(axis=0)

    groups = np.full_like(below, True), with_it & ~below, below & ~with_it, ~below & ~with_it
    pushes, repaired, lost, left = (
        np.bincount(sectors[one], minlength=len(SECTORS)).astype(np.float64) for one in groups
    )
    return Summary(pushes, repaired, lost, left, mean, spread)


def outcome_table(summary: Summary) -> str:
    """Pushes by direction, and how they ended."""
    counts = (summary.pushes, summary.repaired, summary.lost, summary.left)
    rows = [(name, *(f"{int(values[i])}" for values in counts)) for i, name in enumerate(SECTORS)]
    return markdown_table(("push", "pushes", "repaired", "lost by it", "left"), rows)


def correction_table(summary: Summary, step: int) -> str:
    """Mean and standard deviation of the corrections during a step, by direction."""
    rows = [
        (name, *(_cell(m, s) for m, s in zip(summary.mean[step, i], summary.spread[step, i], strict=True)))
        for i, name in enumerate(SECTORS)
    ]
    return markdown_table(("push", *SHOWN), rows)


def _cell(mean: float, spread: float) -> str:
    return "-" if np.isnan(mean) else f"{mean:+.1f} ({spread:.1f})"


ANGLES = np.arange(-180.0, 181.0, 45.0)  # psi of the points [deg]
ORDER = (ANGLES / 45.0).astype(np.int64) % len(SECTORS)
LOOKS = [POLICY_STYLES[name] for name in ("two-stage", "stage-1", "stage-1+cop")]  # of the steps
OUTCOMES = (("repaired", "#0b7a55", ""), ("lost", "#d7191c", "//"), ("left", "#bdbdbd", ".."))


def save_corrections(summary: Summary, directory: Path, stem: str = "corrections") -> list[Path]:
    """Write STEM.png and STEM.svg."""
    with print_style():
        figure = new_figure(10.0, 5.4)
        panels = figure.subplots(2, 4, sharex=True).ravel()
        for decision, (axes, name) in enumerate(zip(panels, SHOWN, strict=False)):
            _decision(axes, summary, decision, name)
        _outcomes(panels[-1], summary)
        for axes in panels:
            axes.set_xticks(ANGLES[::2], ["back", "in", "front", "out", "back"])
            axes.tick_params(axis="x", labelsize=8.0)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower left", ncols=len(labels))
        return save(figure, directory, stem)


def _decision(axes: Any, summary: Summary, decision: int, name: str) -> None:
    """Mean correction against direction, one line a step, with a band of one standard deviation."""
    axes.axhline(0.0, color="#555555", lw=0.8)
    for step, (look, label) in enumerate(zip(LOOKS, STEP_NAMES, strict=True)):
        mean, spread = summary.mean[step, ORDER, decision], summary.spread[step, ORDER, decision]
        axes.plot(ANGLES, mean, color=look.colour, ls=look.line, marker=look.marker, ms=3.5, label=label)
        if step == 0:
            axes.fill_between(ANGLES, mean - spread, mean + spread, color=look.colour, alpha=0.15, lw=0.0)
    axes.set_title(name.replace("acceleration", "acc."), loc="left")


def _outcomes(axes: Any, summary: Summary) -> None:
    """Endings of the pushes that either policy loses, by direction."""
    bottom = np.zeros(len(ANGLES))
    for name, colour, hatch in OUTCOMES:
        values = getattr(summary, name)[ORDER]
        axes.bar(ANGLES, values, 34.0, bottom, color=colour, hatch=hatch, ec="white", lw=0.5, label=name)
        bottom += values
    axes.set_title("pushes lost by either", loc="left")
    axes.set_ylim(0.0, 1.5 * max(bottom.max(), 1.0))  # the legend stands above the bars
    axes.legend(fontsize=8.0, loc="upper left")
