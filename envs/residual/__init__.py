"""Actions that correct a policy below."""
