"""Which parts of a robot's model play which role in walking, by their names."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

from ..errors import InvalidValueError

LEG_JOINTS = 6  # from hip to sole; the fourth is the knee
Pair = tuple[str, str]


@dataclass(frozen=True)
class BodyPlan:
    """The roles that gait machine and whole-body control know, and the names that have them.

    Control knows a floating base, a waist of at most two axes and two legs of six joints each. Order and axes
    of the hip's three joints and of the ankle's two are free. Joints named in `held` keep their angle, as
    those of arms or of a waist that yaws; they may lie between the pelvis and the legs or the waist, too.
    """

    pelvis: str  # body with the free joint, which both legs hang from; x forward, z up where it is upright
    trunk: str  # body above the waist; without a waist it may be the pelvis
    legs: tuple[tuple[str, ...], tuple[str, ...]]  # left, right: from hip to sole, the fourth is the knee
    soles: Pair  # sites in the centres of the soles, x forward, z up
    loads: Pair  # sensors of the normal force under each sole [N]
    sole_boxes: Pair  # geoms that touch the floor, boxes as large as the soles
    waist: tuple[str | None, str | None] = (
        None,
        None,
    )  # joints about y (pitch) and x (roll), or None
    bend: tuple[float, ...] = (0.0,) * LEG_JOINTS  # left leg's angles, near which postures are sought [rad]
    held: tuple[tuple[str, float], ...] = ()  # other joints and the angles that they keep [rad]

    def __post_init__(self) -> None:
        for side, leg in zip(("left", "right"), self.legs, strict=True):
            if len(leg) != LEG_JOINTS:
                raise InvalidValueError(
                    f"the {side} leg of a BodyPlan has {LEG_JOINTS} joints from hip to sole, got {leg!r}"
                )
        if len(self.bend) != LEG_JOINTS:
            raise InvalidValueError(f"BodyPlan.bend has {LEG_JOINTS} angles [rad], got {self.bend!r}")
        if self.trunk == self.pelvis and any(self.waist):
            raise InvalidValueError(
                f"trunk and pelvis of a BodyPlan with a waist are two bodies, got {self.trunk!r} twice"
            )
        names = [*chain(*self.legs), *(name for name in self.waist if name), *(name for name, _ in self.held)]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise InvalidValueError(f"a joint has one role in a BodyPlan, got {', '.join(twice)} twice")
