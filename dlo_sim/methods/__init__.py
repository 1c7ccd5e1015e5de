"""Time integrators: one file per family of methods, and the parts of the implicit step."""
