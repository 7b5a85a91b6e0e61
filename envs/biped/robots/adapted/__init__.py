"""Robots whose models others have made: a robot file says what is what, the model is adapted to control."""
