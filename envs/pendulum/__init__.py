"""The linear inverted pendulum with flywheel, integrated exactly."""
