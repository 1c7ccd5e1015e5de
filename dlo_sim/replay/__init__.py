"""Recorded bags in, predicted bags out, and the comparison of a prediction with a recording."""
