"""Learned policies that come with the package."""
