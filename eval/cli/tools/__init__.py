"""Commands around the scores: names, compilation, timing, tuning, files, and a robot to push."""
