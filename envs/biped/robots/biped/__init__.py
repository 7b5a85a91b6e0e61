"""The 60 kg biped after Table II of the paper."""
