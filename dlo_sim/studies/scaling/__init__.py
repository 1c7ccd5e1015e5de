"""Time of a step and memory against the number of control points."""
