"""Error against run time: cases, references, the diagram, other simulators beside."""
