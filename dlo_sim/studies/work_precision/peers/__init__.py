"""Other simulators on the same cases, each in the environment that it needs."""
