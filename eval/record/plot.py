"""Figures: a recorded episode over time, and the learning curves that the files of policies hold."""

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...controllers.errors import InvalidValueError
from ...controllers.files import write_atomically
from ...controllers.policies.learned import policy_paths
from ...controllers.validation import require_integer, require_number
from ..output.statistics import wilson_interval
from ..rollout.load_policy import named_file, training_note
from . import style
from .record import LIMIT, TORQUE, Array, EpisodeRecord
from .words import push_words, verdict

PLOT_FORMATS = (".png", ".svg")
CMP_LINE: dict[str, Any] = {"color": "#7a5195", "ls": (0, (1, 1)), "lw": 1.6}
JOINTS = ("waist", "hip", "knee", "ankle")  # whose torques are drawn apart
JOINT_COLOURS = ("#0064a8", "#c44601", "#009e73", "#cc79a7")
MARGIN = 0.06  # about what a panel of the floor holds [m]


def write_plot(record: EpisodeRecord, path: Path) -> None:
    """Draw an episode into a picture, in the format of the suffix; the same episode gives the same bytes."""
    buffer = io.BytesIO()
    kind = path.suffix.lower()[1:]
    with style.print_style():
        figure = draw(record)
        figure.savefig(buffer, format=kind, metadata={"Date": None} if kind == "svg" else None)
    write_atomically(path, buffer.getvalue())


def draw(record: EpisodeRecord) -> Any:
    """The figure of an episode; call it inside `print_style`."""
    met = [name for name in record.columns if name.startswith(LIMIT) and record[name].any()]
    heights = [2.0, 2.0, 1.2, 1.3] + ([0.3 + 0.17 * len(met)] if met else [])
    figure = style.new_figure(style.WIDTH, sum(heights) + 0.35 * len(heights) + 0.9)
    panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    for axes, title, axis in ((panels[0], "to the left", "y"), (panels[1], "forward", "x")):
        _floor(axes, record, axis)
        axes.set_title(f"{title}: {axis} [m]", loc="left")
    _trunk(panels[2], record)
    _torques(panels[3], record)
    if met:
        _limits(panels[4], record, met)
    for axes in panels:
        _mark_events(axes, record)
        axes.label_outer()
    time = record["time"]
    panels[-1].set(xlabel="time [s]", xlim=(time[0], time[-1]))
    figure.suptitle(
        f"{record.outcome.policy}, {push_words(record)}: {verdict(record.outcome)}", weight="bold"
    )
    left, right = style.FOOT_COLOURS
    looks = {
        "DCM": style.DCM_LINE, "CoM": style.COM_LINE, "CoP": style.COP_LINE, "CMP": CMP_LINE,
        "left sole, loaded": {"fc": left, "alpha": 0.4},
        "right sole, loaded": {"fc": right, "alpha": 0.4},
        "touchdown": {"color": style.STEP_COLOUR, "lw": 0.8},
        "push": {"fc": style.PUSH_COLOUR, "alpha": 0.3},
    }  # fmt: skip
    style.legend(figure, looks, 4)
    return figure


def _mark_events(axes: Any, record: EpisodeRecord) -> None:
    """Touchdowns as vertical lines, pushes as shaded intervals."""
    time, step = record["time"], record["step"]
    for i in np.flatnonzero(np.diff(step)) + 1:
        axes.axvline(time[i], color=style.STEP_COLOUR, lw=0.8, zorder=1)
    for start, push in zip(record.push_starts, record.scenario.forces, strict=True):
        if start < time[-1]:
            style.shade_push(axes, start, push.duration)


def _floor(axes: Any, record: EpisodeRecord, axis: str) -> None:
    """DCM, CoM, CoP, CMP and the soles that carry load, along one axis of the world."""
    time, half = record["time"], record.sole[axis == "y"] / 2
    seen = []
    for side, colour in zip(("left", "right"), style.FOOT_COLOURS, strict=True):
        place, loaded = record[f"{side}_sole_{axis}"], record[f"{side}_contact"] > 0.0
        look = {"fc": colour, "ec": "none", "alpha": 0.3, "zorder": 2}
        axes.fill_between(time, place - half, place + half, where=loaded, **look)
        axes.plot(time, np.where(loaded, np.nan, place), color=colour, ls=":", lw=1.3, zorder=2)
        seen += [place - half, place + half]
    known = np.where(record["left_contact"] + record["right_contact"] > 0.0, 1.0, np.nan)
    for name, look in (("cmp", CMP_LINE), ("cop", style.COP_LINE)):
        axes.plot(time, record[f"{name}_{axis}"] * known, drawstyle="steps-pre", zorder=4, **look)
    for name, look in (("com", style.COM_LINE), ("dcm", style.DCM_LINE)):
        axes.plot(time, record[f"{name}_{axis}"], zorder=5, **look)
    seen.append(record[f"com_{axis}"])
    axes.set_ylim(min(map(np.min, seen)) - MARGIN, max(map(np.max, seen)) + MARGIN)


def _trunk(axes: Any, record: EpisodeRecord) -> None:
    colours = {"trunk_roll": style.COP_COLOUR, "trunk_pitch": style.COM_COLOUR}
    labels = {"trunk_roll": "roll, positive to the left", "trunk_pitch": "pitch, positive forward"}
    for name, colour in colours.items():
        line = "-" if name == "trunk_roll" else "--"
        axes.plot(record["time"], record[name], color=colour, ls=line, label=labels[name])
    bound = record.bounds["trunk_pitch"]
    if max(np.abs(record[name]).max() for name in colours) > 0.5 * bound:
        style.draw_bounds(axes, bound)
    axes.set_title("trunk: lean [rad]", loc="left")
    axes.legend(loc="upper right", ncols=2, frameon=True, framealpha=0.9)


def _torques(axes: Any, record: EpisodeRecord) -> None:
    """The largest torque against its bound of each kind of joint, on either leg."""
    shares = {
        name: np.abs(record[name]) / record.bounds[name] for name in record.columns if name.startswith(TORQUE)
    }
    groups: dict[str, Array] = {}
    for kind in JOINTS:
        if found := [share for name, share in shares.items() if kind in name]:
            groups[kind] = np.max(found, axis=0)
    groups = groups or {"trunk": np.max(list(shares.values()), axis=0)}
    for (kind, share), colour in zip(groups.items(), JOINT_COLOURS, strict=False):
        axes.plot(record["time"], share, color=colour, lw=1.1, drawstyle="steps-pre", label=kind)
    axes.axhline(1.0, color="#555555", ls="--", lw=1.0)
    axes.set(ylim=(0.0, 1.12))
    axes.set_title("torque, share of the motor's largest", loc="left")
    axes.legend(loc="upper right", ncols=len(groups), frameon=True, framealpha=0.9)


def _limits(axes: Any, record: EpisodeRecord, met: list[str]) -> None:
    """A bar for the time in which a limit is met, a row for each; the first one met is on top."""
    time = record["time"]
    met = sorted(met, key=lambda name: -int(np.flatnonzero(record[name])[0]))
    for row, name in enumerate(met):
        during = np.flatnonzero(record[name][1:]) + 1
        spans = [(time[i - 1], time[i] - time[i - 1]) for i in during]
        axes.broken_barh(spans, (row - 0.35, 0.7), fc="#a6522b", ec="none", zorder=3)
    axes.set_yticks(range(len(met)), [name.removeprefix(LIMIT).replace("_", " ") for name in met])
    axes.set(ylim=(-0.6, len(met) - 0.4))
    axes.set_title("limits met since the first push", loc="left")


MILLION = 1e6
BELOW = 0.05  # the curves
MOST = 10**9  # pushes of a point


@dataclass(frozen=True)
class LearningCurve:
    """One training: the share of the curve's pushes that the policy recovers from, by samples."""

    name: str
    profile: str  # of the robots, or several joined by "and"
    timesteps: tuple[int, ...]  # learned actions
    recovered: tuple[float, ...]
    pushes: int  # of each point
    like: tuple[str, ...] = ()  # kinds of suites that they are drawn like; none: 80-200 N s at the pelvis


def learning_curve(policy: str) -> LearningCurve:
    """Learning curve of a shipped policy, by name, or of a policy file.

    Raises:
        InvalidValueError: the file can't be read, or holds no record of a training.
    """
    path = policy_paths(named_file(policy))[1]
    training = training_note(path)
    try:
        points, profile = training["curve"], training["settings"]["profile"]
        return LearningCurve(
            policy,
            profile if isinstance(profile, str) else " and ".join(profile),
            tuple(int(require_number("timesteps", point["timesteps"], 0.0)) for point in points),
            tuple(require_number("recovered", point["recovered"], 0.0, 1.0) for point in points),
            require_integer("scenarios", points[0]["scenarios"], 1, MOST),
            tuple(dict.fromkeys(training["settings"].get("like", ()))),
        )
    except InvalidValueError as error:
        raise InvalidValueError(f"{path} does not tell how its policy learned: {error}") from None
    except (KeyError, TypeError, ValueError, IndexError):
        raise InvalidValueError(f"{path} does not tell how its policy learned") from None


def save_learning_curves(
    curves: Sequence[LearningCurve], lines: Sequence[tuple[str, float]], directory: Path, stem: str
) -> list[Path]:
    """Write STEM.png and STEM.svg: recovered against learned actions, with Wilson's 95 % intervals as bands.

    `lines` are names and shares of what does not learn.
    """
    with style.print_style():
        figure = style.new_figure(7.2, 4.6)
        axes = figure.subplots()
        for curve in curves:
            _draw_curve(axes, curve)
        for name, share in lines:
            axes.axhline(share, color="#222222", lw=1.0, ls=(0, (5, 2)))
            axes.annotate(
                f"{name}: {share:.3f}", (0.99, share), (0, 2), xycoords=("axes fraction", "data"),
                textcoords="offset points", ha="right", va="bottom", fontsize=8.0,
            )  # fmt: skip
        axes.set_xlabel("learned actions [million]")
        kinds = dict.fromkeys(" and ".join(curve.like) or "hard" for curve in curves)
        axes.set_ylabel(f"recovered, of {curves[0].pushes} pushes like those of {'; '.join(kinds)}")
        least = min(min(curve.recovered) for curve in curves)
        axes.set_ylim(max(math.floor(10.0 * least) / 10.0 - BELOW, 0.0), 1.02)
        figure.legend(loc="outside lower center", ncols=3, fontsize=8.5)
        return style.save(figure, directory, stem)


def _draw_curve(axes: Any, curve: LearningCurve) -> None:
    look = style.curve_style(curve.name)
    x = [steps / MILLION for steps in curve.timesteps]
    bands = [wilson_interval(round(share * curve.pushes), curve.pushes) for share in curve.recovered]
    low, high = zip(*bands, strict=True)
    axes.fill_between(x, low, high, color=look.colour, alpha=0.12, lw=0.0)
    label = curve.name if curve.profile == "exact" else f"{curve.name} ({curve.profile})"
    axes.plot(x, curve.recovered, color=look.colour, ls=look.line, marker=look.marker, ms=4.0, label=label)
