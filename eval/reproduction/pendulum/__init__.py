"""The closed loop of many pendulums: variants of the paper's planner, pushed until they fall."""
