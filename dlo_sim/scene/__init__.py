"""The scene: parameter table, frozen description, and the loader of scene files.

This package contains no numerics and no ROS, and imports no other package of `dlo_sim`.

It checks values itself, in 53 lines of `parameter.py`. The same checks by pydantic 2.13 took 61,
most of them to turn its error codes into our messages (one line with key, value and cure); of 3,528
values tried on all parameters 583 got another message, `true` passed as the number 1.0, and a check
took twenty times as long. The messages of msgspec 0.22 contain neither the value nor a cure.
"""
