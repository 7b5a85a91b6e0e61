"""MJCF model files."""
