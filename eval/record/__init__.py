"""One episode as arrays: columns by name with their units, as a file, as a figure."""
