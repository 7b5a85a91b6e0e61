"""Suites, and what a policy is worth on them."""
