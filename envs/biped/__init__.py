"""The MuJoCo biped under whole-body control."""
