"""The biped under actions on its joints: targets without a planner, or a residual on whole-body control."""
