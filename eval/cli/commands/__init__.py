"""The subcommands: each a frozen dataclass of its options, whose `run` does it."""
