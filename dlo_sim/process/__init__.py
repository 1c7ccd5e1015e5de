"""Process control: signals that end the process, atomic file output, and warnings as lines."""
