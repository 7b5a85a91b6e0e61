"""A robot file and a preset out of a model alone: its parts are guessed, told and written down."""
