"""Process control: its beginning, the signals that end it, its children, and atomic output."""
