"""The robot, its gait box, its observation, its nominal gait, and the limits of recovery."""
