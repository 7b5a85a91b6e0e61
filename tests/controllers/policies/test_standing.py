"""When a standing robot may stay, against the closed form of the margin in place."""

import numpy as np
import pytest
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.observation import DCM, SWING_POSITION, TRUNK_ANGLE, TRUNK_RATE
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.model.standing import HULL_COLUMNS, HULL_ROWS, Feet, standing_margin
from push_recovery.controllers.policies.standing import margin_in_place
from push_recovery.controllers.policies.two_stage import make_policy


@pytest.mark.parametrize(
    ("arm", "soles", "flywheel"),
    [("two-stage", True, True), ("stage-1+cop", True, False), ("stage-1+momentum", False, True)],
)
def test_the_margin_is_that_of_what_the_variant_may_use(arm, soles, flywheel):
    """Without a CoP that it may move, it has the middle between the feet and not the line between them."""
    robot, rng = RobotModel(), np.random.default_rng(3)
    limits, policy = GaitLimits.of(robot), make_policy(arm, robot)
    seen, hull = np.zeros(36), np.empty((HULL_ROWS, HULL_COLUMNS))
    seen[0] = -1.0
    seen[SWING_POSITION][:2] = 0.05, robot.pelvis_width
    policy.predict(seen)
    stander = policy._standers[0]
    for _ in range(50):
        seen[DCM], seen[TRUNK_ANGLE] = rng.uniform(-0.2, 0.3, 2), rng.uniform(-0.5, 0.5, 2)
        seen[TRUNK_RATE] = rng.uniform(-1.0, 1.0, 2)
        expected = standing_margin(
            robot, limits, Feet((0.05, robot.pelvis_width)), seen[DCM], seen[TRUNK_ANGLE], seen[TRUNK_RATE],
            soles=soles, flywheel=flywheel,
        )  # fmt: skip
        found = margin_in_place(seen, stander._constants, stander._in_place.capture, hull)
        assert found == pytest.approx(expected, abs=1e-12)
