"""Compilation of Python functions: vector lanes, kernels, and the cache of machine code."""
