"""From measurement to observation, and what a robot learns of itself while it walks."""
