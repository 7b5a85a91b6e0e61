"""Policies: the two-stage planner and its variants, linear MPC, residuals, and learned policies in numpy."""
