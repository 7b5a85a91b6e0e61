"""Push protocols of other groups on this project's robot, scaled by mass, beside what they published."""
