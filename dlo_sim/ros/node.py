"""The node `dlo_sim`: time, topics, parameters and services around one session.

A callback hands over, asks the session to advance to a time, publishes. What a message means, how far a tick goes and
what is worth a warning is decided in `dlo_sim.session`, which the bag replay shares.
"""

import time
from typing import Any

from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from dlo_sim.ros.parameters import SceneParameters, one_line, refuse_unknown_overrides
from dlo_sim.ros.status import NodeStatus
from dlo_sim.ros.timing import TickTimes
from dlo_sim.ros.topics import Inputs, Outputs
from dlo_sim.scene.description import Scene
from dlo_sim.session.session import Session

_DIAGNOSTICS_PERIOD = 1.0  # [s], REP-107


class CableNode(Node):
    """Predicts a cable live.

    Attributes:
        failure: why the node must end, one line; None while all is well.
    """

    def __init__(self, **options: Any) -> None:
        """Read the parameters, build and compile the simulator, then open topics, services and timers.

        Args:
            options: passed to `rclpy.node.Node`.

        Raises:
            SceneError: a parameter is refused.
            ValueError: the scene cannot be simulated.
        """
        super().__init__("dlo_sim", **options)
        self.failure: str | None = None
        self._parameters: SceneParameters[Scene] = SceneParameters(self)
