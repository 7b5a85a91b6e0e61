"""Small quadratic programs: DAQP from compiled code, and any solver for a second opinion."""
