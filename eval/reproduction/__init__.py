"""The paper's results, measured again: its two scenarios, ablations of the planner, and what theory allows."""
