"""Entry point of the node: `ros2 run dlo_sim node` and `dlo_sim node` end here."""

import sys
from collections.abc import Sequence

from dlo_sim.process import stopping
from dlo_sim.ros import DONE, REFUSED
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.refusal import one_line


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until a signal; returns the exit status.

    `arguments`: command line without the program's name; default: that of the process. Raises
    KeyboardInterrupt if a signal came before the node was there.
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

        from dlo_sim.ros.cables import cables, run_cables
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
        return run_cables(cables(given))
    finally:
        rclpy.try_shutdown()


def _refuse(reason: str) -> int:
    sys.stderr.write(f"dlo_sim: error: {one_line(reason)}\n")
    return REFUSED
