"""The compiled loop reads every array of a planner where it lies, and the scalars by their names."""

import numpy as np
import pytest
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.settings import preset_config
from push_recovery.controllers.stage_2.single_support import CopPlanner
from push_recovery.controllers.stage_2.tables import box_of, constants_of, memory_of, tables_of

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)


@pytest.mark.parametrize("use_trunk", [True, False])
def test_what_is_read_is_what_the_planner_holds(use_trunk):
    planner = CopPlanner(ROBOT, LIMITS, preset_config("default").replace(use_trunk=use_trunk), workers=2)
    assert constants_of(planner.packed[0]) == planner.constants
    np.testing.assert_array_equal(box_of(planner.packed[0]), LIMITS.box)
    for packed, parts in zip(planner.packed, planner._parts, strict=True):
        for found, held in ((tables_of(packed), planner.tables), (memory_of(packed), parts.memory)):
            assert type(found) is type(held)
            for name, own, other in zip(held._fields, found, held, strict=True):
                assert other.flags.c_contiguous, name
                assert own.ctypes.data == other.ctypes.data, name
                assert (own.dtype, own.shape) == (other.dtype, other.shape), name
                assert own.flags.c_contiguous, name
