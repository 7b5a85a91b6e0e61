"""The face of a session in a web browser."""
