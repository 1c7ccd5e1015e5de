"""Compilation of Python functions: vector lanes, pieces, and the cache of machine code."""
