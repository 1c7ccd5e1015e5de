"""Time integrators, a file per family: the step, what it may be combined with, its stable step."""
