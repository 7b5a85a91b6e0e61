"""The commands that score: each a frozen dataclass of its options, whose `run` does it."""
