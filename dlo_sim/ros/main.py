"""Entry point of the node: `ros2 run dlo_sim node` and `dlo_sim node` end here.

Exit status: 0 after SIGINT or SIGTERM; 2 refused input or no ROS (one line on stderr); 3 the
simulator failed and `integrator.on_failure` is `stop`.
"""

import gc
import sys
import traceback
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from dlo_sim.process import stopping
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.refusal import one_line

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from dlo_sim.ros.cable_node import CableNode
    from dlo_sim.ros.cables import Makers

DONE, REFUSED, FAILED = 0, 2, 3

_LONGEST_SPIN = 0.2  # [s]; a signal is noticed after this long also when no timer fires


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until a signal; returns the exit status.

    Args:
        arguments: command line without the program's name; default: that of the process.

    Raises:
        KeyboardInterrupt: a signal asked for the end before the node was there.
    """
    try:
        return _run(list(sys.argv[1:] if arguments is None else arguments))
    except SceneError as refusal:
        return _refuse(str(refusal))


def _run(arguments: list[str]) -> int:
    from dlo_sim.ros.arguments import parser, read_arguments

    if arguments[:1] in (["-h"], ["--help"]):
        parser().print_help()
        return DONE
    try:
        import rclpy
        import rclpy.signals

        from dlo_sim.ros.cables import cables
    except ImportError as error:
        if (error.name or "").startswith("dlo_sim"):
            raise
        if (error.name or "").startswith("rosbags"):
            return _refuse("messages need rosbags; install it with: pip install rosbags")
        return _refuse(
            f"the node needs ROS 2, which cannot be imported ({error}); install it with: "
            "pip install 'dlo_sim[ros]', or source your ROS 2 Jazzy"
        )
    stopping.check()
    with read_arguments(arguments) as given:
        try:
            no_handlers = rclpy.signals.SignalHandlerOptions.NO
            rclpy.init(args=given.for_rcl, signal_handler_options=no_handlers)
        except (RuntimeError, UnicodeError) as error:
            return _refuse(f"ROS refuses the arguments: {error}")
    try:
        stopping.check()
        return _run_all(cables(given))
    finally:
        rclpy.try_shutdown()


def _run_all(makers: "dict[str, Makers]") -> int:
    """Run every cable in a thread of its own, so that none waits for another; the worst status."""
    running = list(makers)
    with ThreadPoolExecutor(len(makers)) as pool:
        ends = [pool.submit(_run_cable, name, makers[name], running) for name in makers]
    return max(end.result() for end in ends)


def _run_cable(name: str, makers: "Makers", running: list[str]) -> int:
    """Run a cable until a signal or until it gives up, which the others do not notice; why is in
    /diagnostics as long as they run.

    Args:
        name: for messages.
        running: the names of all that run; this one takes itself off.
    """
    status, failure = FAILED, None
    node: CableNode | None = None
    try:
        node = makers.cable()
        node.start()
        _spin(node)
        failure = node.failure
    except SceneError as refusal:
        status, failure = REFUSED, one_line(str(refusal))
    except Exception:
        traceback.print_exc()
        failure = "an error of the program, see above"
    finally:
        running.remove(name)
        if not running:
            stopping.disable_forced_exit()
        if node is not None:
            node.end()
            node.destroy_node()
    if failure is None:
        return DONE
    # One piece: several cables may end at once.
    label = f"{'error: ' if status == REFUSED else ''}{name}{': ' if name else ''}"
    sys.stderr.write(f"dlo_sim: {label}{failure}\n")
    makers.keep_saying(failure, running)
    return status


def _spin(node: "CableNode") -> None:
    """Run callbacks until a signal or until the cable gives up."""
    executor = new_executor()
    executor.add_node(node)
    try:
        # What start-up has allocated stays; the collector need not look at it during a tick.
        gc.collect()
        gc.freeze()
        while not stopping.requested() and node.failure is None:
            executor.spin_once(timeout_sec=_LONGEST_SPIN)
    finally:
        executor.shutdown()


def new_executor() -> "Executor":
    """The events executor, which needs a third of the processor time, or else the usual one."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:  # an older rclpy of the same distribution
        from rclpy.executors import SingleThreadedExecutor

        return SingleThreadedExecutor()
    return EventsExecutor()


def _refuse(reason: str) -> int:
    sys.stderr.write(f"dlo_sim: error: {one_line(reason)}\n")
    return REFUSED
