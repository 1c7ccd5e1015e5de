"""Recorded cables beside predictions of them."""
