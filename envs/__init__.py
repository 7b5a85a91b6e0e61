"""Gymnasium environments: the abstract pendulum and the MuJoCo biped."""
