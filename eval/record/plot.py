"""A recorded episode as a figure: both directions, trunk, torques and limits over time."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from ...controllers.files import write_atomically
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
    for start, push in zip(record.push_starts, record.scenario.pushes, strict=True):
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
