"""Actions on the joints, without a planner: PD torques, touchdown from the contacts, proprioception."""
