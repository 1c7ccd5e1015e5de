"""From input messages through the simulator to output messages, for the live node and the bag
replay.

It works on serialised messages (CDR bytes) and integer nanoseconds, without ROS or bags. In the
order in which data pass:
- `session`: passes messages to the intake and ticks to the drive;
- `topics`, `cdr`: which topics a scene has, and what their bytes mean;
- `intake`: checks a message; `time_base` decides from its stamp whether and when it takes effect;
- `waiting`, `gripper_path`, `observer`: the queues of loads, poses and measured points;
- `pacing`: how far a tick goes; `drive`: applies the inputs that are due, and steps;
- `outputs`: the messages of a state; `plans`: those of a planned motion;
- `diagnostics`: counters of what happened; `saved_state`: a state in a file.
"""
