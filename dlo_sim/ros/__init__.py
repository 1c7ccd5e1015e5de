"""The ROS 2 shell: owns time, topics, parameters and the process; everything else is the session's.

This is the only room that imports rclpy.
"""

DONE, REFUSED, FAILED = 0, 2, 3
"""Exit statuses of the node: ended by a signal; refused input or no ROS; the simulator failed and
`integrator.on_failure` is `stop`.
"""
