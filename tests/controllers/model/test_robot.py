"""Froude's similarity, held against two pendulums of which one is the other made larger."""

import math

import pytest
from push_recovery.controllers.model.capturability import max_recoverable_impulse
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import SAME, RobotModel, Similarity

LARGE = RobotModel(
    mass=120.0, com_height=1.8, trunk_inertia=8.0 * 2.0 * 2.25**2, trunk_torque_max=150.0 * 2.0 * 2.25,
    foot_length=0.45, foot_width=0.225, pelvis_width=0.45,
)  # fmt: skip  # 2 times as heavy, 2.25 times as high


def test_ratios_by_hand():
    ratios = Similarity.of(LARGE)
    assert (ratios.mass, ratios.length) == (2.0, 2.25)
    assert (ratios.time, ratios.velocity) == (1.5, 1.5)
    assert (ratios.impulse, ratios.torque, ratios.power) == (3.0, 4.5, 3.0)
    assert (ratios.damping, ratios.inertia) == (6.75, 10.125)
    assert Similarity.of(RobotModel()) == SAME
    assert Similarity.of(RobotModel(), LARGE) == Similarity(0.5, 0.8 / 1.8)


@pytest.mark.parametrize("psi", [0.0, 1.0, math.pi / 2, 2.5, -math.pi / 2])
def test_the_largest_impulse_goes_with_the_ratio(psi):
    """The closed form knows nothing of similarity; with all that it takes scaled it has to obey it."""
    small, large = GaitLimits.of(RobotModel()), GaitLimits.of(LARGE)
    limits = GaitLimits(
        **{
            name: getattr(small, name) * factor
            for names, factor in (
                (("length_min", "length_max", "width_min", "width_max", "cop_x_max", "cop_y_max"), 2.25),
                (("duration_min", "duration_max"), 1.5),
                (("trunk_acceleration_max",), 1.0 / 2.25),
            )
            for name in names
        }
    )
    assert large.cop_x_max == pytest.approx(2.25 * small.cop_x_max)
    own = max_recoverable_impulse(RobotModel(), psi, limits=small)
    assert max_recoverable_impulse(LARGE, psi, limits=limits) == pytest.approx(3.0 * own, rel=1e-9)
