"""Networks of Stable-Baselines3: made, begun as a policy, and read into numpy."""
