"""The entry points `dlo_sim`, `node` and `python -m dlo_sim`.

Signals are taken care of before anything else is imported. One that arrives while Python itself is
starting gets Python's default handling: exit by the signal, for SIGINT possibly with a traceback.
A launcher can prevent that: `env --block-signal=INT,TERM dlo_sim ...` loses none.
"""

import signal
import sys
from collections.abc import Callable

_ENDED = 0  # a node is there to be ended by a signal


def main() -> int:
    """The command `dlo_sim`; returns the exit status."""
    _begin()

    def command() -> int:
        from dlo_sim.cli.main import main

        return main()

    return _supervised(command, is_node=sys.argv[1:2] == ["node"])


def node() -> int:
    """The executable `node`, which ROS starts; returns the exit status."""
    _begin()

    def run() -> int:
        from dlo_sim.ros.main import main

        return main()

    return _supervised(run, is_node=True)


def _begin() -> None:
    """Let signals wait until the work is supervised."""
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))

    from dlo_sim.process.beginning import begin

    begin()


def _supervised(work: Callable[[], int], is_node: bool) -> int:
    from dlo_sim.process.beginning import use_lines
    from dlo_sim.process.stopping import exit_status, supervised

    use_lines()
    return supervised(work, (lambda: _ENDED) if is_node else exit_status)


if __name__ == "__main__":
    sys.exit(main())
