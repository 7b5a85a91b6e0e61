"""Learning curves from the files of policies, and their figure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.policies.learned import policy_paths
from ..output.statistics import wilson_interval
from ..rollout.load_policy import named_file, training_note
from .style import curve_style, new_figure, print_style, save

MILLION = 1e6
MARGIN = 0.05  # below the curves


@dataclass(frozen=True)
class LearningCurve:
    """One training: the share of the curve's pushes that the policy recovers from, by samples."""

    name: str
    profile: str  # of the robots
    timesteps: tuple[int, ...]  # learned actions
    recovered: tuple[float, ...]
    pushes: int  # of each point


def learning_curve(policy: str) -> LearningCurve:
    """Learning curve of a shipped policy, by name, or of a policy file.

    Raises:
        InvalidValueError: the file can't be read, or holds no record of a training.
    """
    path = policy_paths(named_file(policy))[1]
    training = training_note(path)
    try:
        points = training["curve"]
        return LearningCurve(
            policy,
            str(training["settings"]["profile"]),
            tuple(int(point["timesteps"]) for point in points),
            tuple(float(point["recovered"]) for point in points),
            int(points[0]["scenarios"]),
        )
    except (KeyError, TypeError, ValueError, IndexError):
        raise InvalidValueError(f"{path} does not tell how its policy learned") from None


def save_learning_curves(
    curves: Sequence[LearningCurve], lines: Sequence[tuple[str, float]], directory: Path, stem: str
) -> list[Path]:
    """Write STEM.png and STEM.svg: recovered against learned actions, with Wilson's 95 % intervals as bands.

    `lines` are names and shares of what does not learn.
    """
    with print_style():
        figure = new_figure(7.2, 4.6)
        axes = figure.subplots()
        for curve in curves:
            _draw(axes, curve)
        for name, share in lines:
            axes.axhline(share, color="#222222", lw=1.0, ls=(0, (5, 2)))
            axes.annotate(
                f"{name}: {share:.3f}", (0.99, share), (0, 2), xycoords=("axes fraction", "data"),
                textcoords="offset points", ha="right", va="bottom", fontsize=8.0,
            )  # fmt: skip
        axes.set_xlabel("learned actions [million]")
        axes.set_ylabel(f"recovered, of {curves[0].pushes} pushes of 80-200 N s")
        least = min(min(curve.recovered) for curve in curves)
        axes.set_ylim(max(math.floor(10.0 * least) / 10.0 - MARGIN, 0.0), 1.02)
        figure.legend(loc="outside lower center", ncols=3, fontsize=8.5)
        return save(figure, directory, stem)


def _draw(axes: Any, curve: LearningCurve) -> None:
    look = curve_style(curve.name)
    x = [steps / MILLION for steps in curve.timesteps]
    bands = [wilson_interval(round(share * curve.pushes), curve.pushes) for share in curve.recovered]
    low, high = zip(*bands, strict=True)
    axes.fill_between(x, low, high, color=look.colour, alpha=0.12, lw=0.0)
    label = curve.name if curve.profile == "exact" else f"{curve.name} ({curve.profile})"
    axes.plot(x, curve.recovered, color=look.colour, ls=look.line, marker=look.marker, ms=4.0, label=label)
