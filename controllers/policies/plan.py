"""What the two-stage planner decided for one observation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..model.gait_box import COP, DURATION, GAIT_SIZE, STEP, TRUNK
from ..model.nominal_gait import NOMINAL_SIZE, NominalGait
from ..stage_1.columns import DCM_END, HELD, NOMINAL, OFFSET, REMAINING, TARGET

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """What a policy decided for one observation, canonical frame."""

    gait: Floats  # (7,), units of GAIT_NAMES
    offset: Floats  # DCM offset b that stage 1 expects, (2,) [m]
    nominal: NominalGait
    dcm_target: Floats  # xi_des = u_T + b_nom, (2,) [m]
    dcm_end: Floats  # DCM that stage 2 expects at touchdown, (2,) [m]; u_T + b without stage 2
    remaining: float  # until the new foot carries load [s]
    held: bool  # the step plan is the previous one
    status: str  # of stage 2's solver, or of the arm

    @property
    def step(self) -> Floats:
        """Foothold u_T, (2,) [m]."""
        return self.gait[STEP : STEP + 2]

    @property
    def duration(self) -> float:
        """Step duration T [s]."""
        return float(self.gait[DURATION])

    @property
    def cop(self) -> Floats:
        """CoP, (2,) [m]."""
        return self.gait[COP : COP + 2]

    @property
    def trunk_acceleration(self) -> Floats:
        """Trunk angular acceleration: pitch, roll, (2,) [rad/s^2]."""
        return self.gait[TRUNK : TRUNK + 2]


def plan_of_row(row: Floats, status: str) -> Plan:
    """The plan in a row (ROW_SIZE,) that both stages have written."""
    return Plan(
        gait=row[:GAIT_SIZE],
        offset=row[OFFSET : OFFSET + 2],
        nominal=NominalGait(*(float(value) for value in row[NOMINAL : NOMINAL + NOMINAL_SIZE])),
        dcm_target=row[TARGET : TARGET + 2],
        dcm_end=row[DCM_END : DCM_END + 2],
        remaining=float(row[REMAINING]),
        held=bool(row[HELD]),
        status=status,
    )
