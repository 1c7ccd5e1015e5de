"""Compiled steps: numba functions on plain arrays. They know nothing of scenes, ROS or files.

`layout` says what the arrays mean; `jit` how they are compiled and cached; the rest is one file a
subject. `dlo_sim.core` holds the slow and obvious twins that the tests compare them with.
"""
