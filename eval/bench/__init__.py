"""What a second of a robot costs."""
