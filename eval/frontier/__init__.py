"""The largest push by direction, beside its closed form."""
