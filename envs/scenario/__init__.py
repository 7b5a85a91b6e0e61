"""Scenarios: disturbances, command, model errors and noise of an episode, complete and frozen."""
