"""Other simulators on the same cases, each in its own Python environment."""
