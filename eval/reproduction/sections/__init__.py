"""The sections of the reproduction: jobs, summary, tables, pictures."""
