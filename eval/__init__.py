"""Suites, rollouts, statistics and the command line."""
