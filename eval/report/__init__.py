"""The report of a command as one page that needs no network."""
