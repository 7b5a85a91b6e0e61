"""Rows, progress and tables."""
