"""Commands for what goes from one group to another: suites, protocols of others, results."""
