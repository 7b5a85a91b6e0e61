"""Learned policies: networks that run in numpy, what they see, and their files."""
