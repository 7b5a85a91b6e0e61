"""From observations to actions: the planner and its arms, learned policies, residuals."""
