"""Pure numerics of a spline cable in plain numpy: no ROS, no files, no plots, no compiler."""
