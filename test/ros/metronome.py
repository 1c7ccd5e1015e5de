"""Sleeps for 5 ms again and again on one core and says when it woke late: what the machine did.

Usage: metronome.py CORE; every late waking is a line `begin end` [ns, system clock]. A process that
only sleeps is late because its core stood still, not because of anything that runs on it.
"""

import os
import sys
import time

PERIOD = 0.005
LATE = 7_500_000  # [ns]; a core that stands still for 7.5 ms makes every sleep as long

os.sched_setaffinity(0, {int(sys.argv[1])})
before = time.time_ns()
while True:
    time.sleep(PERIOD)
    now = time.time_ns()
    if now - before > LATE:
        print(before, now, flush=True)
    before = now
