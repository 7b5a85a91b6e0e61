"""Learned policies in the formats of others."""
