"""Pictures that move: an episode, or the same push under two policies side by side."""
