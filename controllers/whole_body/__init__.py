"""From an action to joint torques: gait machine, tasks, inverse dynamics within its bounds."""
