"""Sampling MPC: corrections of the planner, tried on copies of the robot before one of them is done."""
