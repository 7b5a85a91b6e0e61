"""`push-recovery curves`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from ....controllers.errors import InvalidValueError
from ..options import Directory, Options, within

FOLDER = Path("runs/curves")
BASE = "residual"  # whose curve begins at the planner's own share


@dataclass(frozen=True, kw_only=True)
class Curves(Options):
    """Learning curves of policies, as their files tell them."""

    policies: Annotated[
        Positional[tuple[str, ...]], arg(metavar="[NAME|FILE ...]", help_behavior_hint="")
    ] = ("",)
    """Learned policies by name or file (by default all that come with the package)."""
    ceiling: Annotated[float | None, arg(metavar="X", help_behavior_hint="")] = field(
        default=None, metadata=within(0, 1)
    )
    """Share of pushes, 0 to 1, that is drawn as the ceiling, such as that of hard (docs/ceiling.md)."""
    out: Directory = None
    """Directory for curves.png and curves.svg (default: runs/curves)."""

    def run(self) -> None:
        """Draw, and print the last point of each.

        Raises:
            InvalidValueError: there is no policy, or a file tells of no training.
        """
        from ...learned.learning_curve import learning_curve, save_learning_curves
        from ...shipped.names import shipped_names

        names = shipped_names() if self.policies == ("",) else self.policies
        if not names:
            raise InvalidValueError("no trained policy comes with this version: name a policy file")
        curves = [learning_curve(name) for name in names]
        lines = [(f"two-stage, {c.profile}", c.recovered[0]) for c in curves if c.name == BASE]
        if self.ceiling is not None:
            lines.append(("ceiling", self.ceiling))
        directory = FOLDER if self.out is None else Path(self.out)
        directory.mkdir(parents=True, exist_ok=True)
        for curve in curves:
            first, last, steps = curve.recovered[0], curve.recovered[-1], curve.timesteps[-1]
            print(f"{curve.name}, {curve.profile}: {first:.3f} -> {last:.3f} after {steps} actions")
        for path in save_learning_curves(curves, lines, directory, "curves"):
            print(path)
