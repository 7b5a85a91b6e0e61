"""Looks at learned policies: how they learned, and what a residual adds to the policy below."""
