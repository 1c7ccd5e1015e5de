"""From input messages through the simulator to output messages; shared by the live node and the bag
replay. Works on serialised messages (CDR bytes) and integer nanoseconds, without ROS or bags.

In the order in which data fall:
- `session`: the way of everything; a message goes to the intake, a tick to the drive;
- `topics`, `cdr`: which topics a scene has, and what their bytes mean;
- `intake`: checks a message; `time_base` decides from its stamp whether and when it takes effect;
- `waiting`, `gripper_path`, `observer`: the queues of loads, poses and measured points;
- `pacing`: how far a tick goes;
- `drive`: takes what is due out of the queues, and steps the simulator;
- `outputs`: the messages of a state; `plans`: those of a planned motion;
- `diagnostics`: what has happened, counted; `saved_state`: a state in a file.
"""
