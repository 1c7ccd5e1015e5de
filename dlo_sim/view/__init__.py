"""Visualisation of a run from a recording or a bag: as a page, pictures or a film."""
