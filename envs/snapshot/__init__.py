"""The whole state of one robot as an object of its own, to be put back in any place."""
