"""Timings of planner, control and physics."""
