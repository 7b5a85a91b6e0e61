"""Results of many in one place: each checked by running a sample of it again, and ranked by suite."""
