"""The robot and its floor as they are, where they are not what control takes them for."""
