"""Stage 2: CoP and trunk acceleration until touchdown, so that the DCM ends where it should."""
