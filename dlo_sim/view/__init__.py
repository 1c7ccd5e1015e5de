"""A run to look at: read from a recording or a bag; as a page, as pictures, as a film."""
