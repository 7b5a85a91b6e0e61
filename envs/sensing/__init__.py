"""What a robot's own sensors tell of it, instead of the state that the physics has."""
