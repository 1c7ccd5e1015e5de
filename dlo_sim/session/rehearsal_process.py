"""A process that rehearses the scene on its standard input, beside more urgent work.

It stands back before it imports anything large: that takes a second of a core.
"""

import json
import os
import sys

from dlo_sim.session.time_slice import LONG, ask_for_time_slice


def main() -> None:
    """Rehearse."""
    os.nice(10)
    ask_for_time_slice(LONG)

    from dlo_sim.scene.loading import scene_from_values
    from dlo_sim.session.rehearsal import rehearse

    rehearse(scene_from_values(json.load(sys.stdin)), live=True)


if __name__ == "__main__":
    main()
