"""Episodes of n robots: start, planning period, reward, end; Gymnasium's face of them."""
