"""Process control: signals that end the process, and files that are written atomically."""
