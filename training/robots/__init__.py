"""The robots that are trained on: where they begin, what they see and do, what it is worth."""
