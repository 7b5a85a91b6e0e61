"""What is known without looking: the robot, its gait box, its nominal gait and what can be captured."""
