"""Compiled steps: numba functions on plain arrays. They know nothing of scenes or ROS.

`layout` says what the arrays mean; `jit` how they are compiled, `cache`, `code_files` and `turns`
how the machine code is kept and who compiles it; the rest is one file a subject. `dlo_sim.core`
holds the slow and obvious twins that the tests compare them with.
"""
