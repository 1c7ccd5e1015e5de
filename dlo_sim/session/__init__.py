"""From input messages through the simulator to output messages; shared by the live node and the bag
replay.

Works on serialised messages (CDR bytes) and integer nanoseconds, without ROS or bags.
"""
