"""Entry point of the node: `ros2 run dlo_sim node` and `dlo_sim node` end here.

Exit status: 0 after SIGINT or SIGTERM; 2 refused input or no ROS (one line on stderr); 3 the
simulator failed and `integrator.on_failure` is `stop`. Top-level imports stay light, so that the
signal handlers are in place early.
"""

import signal
import sys
from collections.abc import Sequence
from types import FrameType
from typing import TYPE_CHECKING

from dlo_sim.ros.residence import settle
from dlo_sim.scene.loading import SceneError
from dlo_sim.session.time_slice import SHORT, ask_for_time_slice

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from dlo_sim.ros.node import CableNode

DONE, REFUSED, FAILED = 0, 2, 3

_RETRY = 0.1  # [s]; until a lost `Terminated` is raised again
_LONGEST_SPIN = 0.2  # [s]; a signal is noticed after this long also when no timer fires


class Terminated(BaseException):
    """SIGINT or SIGTERM came while the node was starting up."""


class Termination:
    """Remembers that a signal asked the process to end.

    While starting up (imports and compiling can take many seconds) the signal also raises
    `Terminated`; afterwards the executor loop looks at `requested`, so that no callback is cut in
    two. An exception that happens to be raised inside a callback from C, as compilers make them, is
    lost; so it is raised again until start-up has ended.
    """

    def __init__(self) -> None:
        self.requested = False
        self._raises = True

    def install(self) -> None:
        """Take over SIGINT and SIGTERM (and SIGALRM, to try again)."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
            signal.signal(number, self._note)

    def only_note(self) -> None:
        """End of start-up: signals raise nothing from now on."""
        self._raises = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.requested = True
        if self._raises:
            signal.setitimer(signal.ITIMER_REAL, _RETRY)
            raise Terminated


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until a signal; returns the exit status.

    Args:
        arguments: command line without the program's name; default: that of the process.
    """
    termination = Termination()
    termination.install()
    try:
        return _run(list(sys.argv[1:] if arguments is None else arguments), termination)
    except Terminated:
        return DONE
    except SceneError as refusal:
        return _refuse(str(refusal))
    finally:
        termination.only_note()


def _run(arguments: list[str], termination: Termination) -> int:
    from dlo_sim.ros.arguments import parser, read_arguments

    if arguments[:1] in (["-h"], ["--help"]):
        parser().print_help()
        return DONE
    try:
        import rclpy
        import rclpy.signals

        from dlo_sim.ros.node import CableNode
    except ImportError as error:
        if (error.name or "").startswith("dlo_sim"):
            raise
        return _refuse(
            f"the node needs ROS 2, which cannot be imported ({error}); install it with: "
            "pip install 'dlo_sim[ros]', or source your ROS 2 Jazzy"
        )
    ask_for_time_slice(SHORT)  # before ROS starts threads, which inherit it
    with read_arguments(arguments) as given:
        try:
            no_handlers = rclpy.signals.SignalHandlerOptions.NO
            rclpy.init(args=given.for_rcl, signal_handler_options=no_handlers)
        except (RuntimeError, UnicodeError) as error:
            return _refuse(f"ROS refuses the arguments: {error}")
    node: CableNode | None = None
    try:
        node = CableNode(given)
        return _spin(node, termination)
    finally:
        termination.only_note()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def _spin(node: "CableNode", termination: Termination) -> int:
    """Run callbacks until a signal or until the node gives up; then take the markers back."""
    executor = _executor()
    executor.add_node(node)
    try:
        termination.only_note()
        settle()
        while not termination.requested and node.failure is None:
            executor.spin_once(timeout_sec=_LONGEST_SPIN)
    finally:
        node.say_goodbye()
        executor.shutdown()
    if node.failure is None:
        return DONE
    print(f"dlo_sim: {node.failure}", file=sys.stderr)
    return FAILED


def _executor() -> "Executor":
    """The events executor, which needs a third of the processor time, or else the usual one."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:  # an older rclpy of the same distribution
        from rclpy.executors import SingleThreadedExecutor

        return SingleThreadedExecutor()
    return EventsExecutor()


def _refuse(reason: str) -> int:
    print(f"dlo_sim: error: {' '.join(reason.split())}", file=sys.stderr)
    return REFUSED


if __name__ == "__main__":
    sys.exit(main())
