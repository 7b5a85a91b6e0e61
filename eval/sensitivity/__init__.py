"""What the outcomes of a suite hang on: solvers, time steps, contacts, losses, delays."""
