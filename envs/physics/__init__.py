"""MuJoCo: n simulations stepped from compiled loops, pictures without a window."""
