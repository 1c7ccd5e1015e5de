"""Endurance tests of session and node: long runs, bad input, disturbances, overload."""
