"""A robot to play with: walks, is told, pushed, put back and compared; no viewer in it, none needed."""
