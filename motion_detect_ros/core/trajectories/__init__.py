"""Second source of candidates: long, sparse point trajectories, for what is small or slow."""
