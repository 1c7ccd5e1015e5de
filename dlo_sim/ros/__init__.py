"""The ROS 2 shell: owns time, topics, parameters and the process; everything else is the session's.

This is the only room that imports rclpy.
"""
