"""A policy on joints from a planner that shows what it would ask of them: DAgger, before PPO."""
