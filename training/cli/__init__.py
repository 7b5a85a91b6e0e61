"""The commands that train; the only part of this package that loads without torch."""
