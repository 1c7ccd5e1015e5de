"""The scene: parameter table, frozen description, and the loader of scene files.

This package contains no numerics and no ROS, and imports no other package of `dlo_sim`.
"""
