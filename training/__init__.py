"""Learning on top of the planner; the only package that imports torch."""
