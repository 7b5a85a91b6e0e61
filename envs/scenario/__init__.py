"""What happens in an episode, complete and frozen: pushes, command, model errors, noise."""
