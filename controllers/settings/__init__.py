"""Weights and margins of the planner, and the presets that name them."""
