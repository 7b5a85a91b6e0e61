"""Planners of the field that are no parts of the two-stage planner."""
