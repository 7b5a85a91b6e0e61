"""What is measured of robots while their episodes run."""
