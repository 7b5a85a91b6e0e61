"""Robots: the biped of this package, and models of others made ready to walk here."""
