"""Messages in, simulator, messages out: the one piece of code that the live node and the bag replay
share.

Works on serialised messages (CDR bytes) and integer nanoseconds; knows neither ROS nor bags.
"""
