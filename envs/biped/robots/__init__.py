"""Robots: what a model's parts are called, and what control needs to know of the compiled model."""
