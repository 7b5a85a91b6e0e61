"""All sections in one directory, as a page and as a command."""
