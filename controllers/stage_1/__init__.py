"""Stage 1: where and when the swing foot lands, from the measured DCM."""
