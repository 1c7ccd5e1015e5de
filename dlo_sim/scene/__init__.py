"""The scene: parameter table, frozen description, and the loader of scene files.

This package contains no numerics and no ROS, and imports no other package of `dlo_sim`. It checks
values itself: the same checks by pydantic 2.13 took more lines and twenty times as long, gave other
messages for 583 of 3,528 values, and took `true` for 1.0; messages of msgspec 0.22 contain neither
value nor cure.
"""
