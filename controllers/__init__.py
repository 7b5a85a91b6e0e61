"""Planner on the linear inverted pendulum with flywheel; knows nothing of Gymnasium."""
