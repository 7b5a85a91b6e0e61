"""Fair tuning: a seeded, resumable search for the settings of planner and robot on pushes of its own."""
