"""From scenarios and policies to outcomes: one episode, many, on several processes."""
