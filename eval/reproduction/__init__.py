"""The paper's results, measured again: its two scenarios, ablations, and what theory allows."""
