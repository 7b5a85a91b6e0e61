"""Robots of other sizes: what a push of one is to another.

Two robots of which one is the other made larger move alike where lengths go with the CoM's height h, times
with sqrt(h / g) and forces with the mass m: then accelerations, friction and shares of the weight are the
same (Froude's similarity; Hof 1996, Scaling gait data to body size).
"""

from __future__ import annotations

from dataclasses import dataclass

from .robot import RobotModel

REFERENCE = RobotModel()  # whose pushes all suites, profiles and training settings are written for


@dataclass(frozen=True)
class Similarity:
    """How many times as large each quantity of a robot is as that of another one."""

    mass: float = 1.0
    length: float = 1.0

    @classmethod
    def of(cls, robot: RobotModel, other: RobotModel = REFERENCE) -> Similarity:
        """Of a robot to another one, by their masses and CoM heights."""
        return cls(robot.mass / other.mass, robot.com_height / other.com_height)

    @property
    def time(self) -> float:
        """Of sqrt(h / g), and so of a velocity in m/s."""
        return self.length**0.5

    velocity = time

    @property
    def impulse(self) -> float:
        """Of N s; a force goes with the mass."""
        return self.mass * self.time

    @property
    def torque(self) -> float:
        """Of N m."""
        return self.mass * self.length

    @property
    def damping(self) -> float:
        """Of N m s/rad."""
        return self.torque * self.time

    @property
    def inertia(self) -> float:
        """Of kg m^2."""
        return self.mass * self.length**2

    @property
    def power(self) -> float:
        """Of W."""
        return self.mass * self.velocity


SAME = Similarity()
