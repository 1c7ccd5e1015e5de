"""Error against run time: cases, references, diagrams, and other simulators."""
