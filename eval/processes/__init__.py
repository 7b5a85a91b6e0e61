"""Processes beside this one: a lock on a directory, workers, and Ctrl-C."""
