"""What is simulated: the parameter table, the frozen description, and the loader of scene files.

This room knows no numerics, no ROS and no other room of the package.
"""
