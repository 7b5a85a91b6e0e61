"""A push in the scene: an arrow with its impulse beside it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...record.sampler import Array

LENGTH = 0.01  # of the arrow for an impulse [m per N s]
ABOVE = 0.1  # from the arrow to its text [m]


def impulse_text(impulse: ArrayLike, mass: float) -> str:
    """An impulse (2,) [N s] as it stands beside its arrow."""
    size = float(np.hypot(*np.asarray(impulse, np.float64)))
    return f"{size:.1f} N s  ({size / mass:.2f} N s/kg)"


class PushArrow:
    """An arrow that is hidden until it is shown.

    Args:
        server: of viser.
        name: of the arrow in the scene; places are in the frame above it.
        colour: red, green, blue in 0-255.
    """

    def __init__(self, server: Any, name: str, colour: tuple[int, int, int]):
        nothing = np.zeros((1, 2, 3), np.float32)
        self._arrow = server.scene.add_arrows(
            name, nothing, colour, shaft_radius=0.012, head_radius=0.035, head_length=0.07, visible=False
        )
        self._label = server.scene.add_label(f"{name} label", "", visible=False, anchor="bottom-center")
        self.text = ""  # what stands beside it now

    def show(self, tail: ArrayLike, impulse: ArrayLike, mass: float) -> None:
        """Draw an impulse (2,) [N s] from a point (3,) [m] on."""
        start, along = np.asarray(tail, np.float64), LENGTH * np.asarray(impulse, np.float64)
        tip: Array = start + np.array([*along, 0.0])
        self._arrow.points = np.array([[start, tip]], np.float32)
        self.text = self._label.text = impulse_text(impulse, mass)
        self._label.position = tuple(((start + tip) / 2 + (0.0, 0.0, ABOVE)).tolist())
        self._arrow.visible = self._label.visible = True

    def hide(self) -> None:
        """Show nothing."""
        self.text = ""
        self._arrow.visible = self._label.visible = False
