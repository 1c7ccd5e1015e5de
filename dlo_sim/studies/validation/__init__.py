"""Comparison of predictions with recorded cables."""
