"""From a model of somebody else's to a robot file and its preset."""
