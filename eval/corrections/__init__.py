"""What a residual adds to the policy below, by push direction and step, and what that repairs."""
