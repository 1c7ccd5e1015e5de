"""Numbers of random examples: few in every test run, many with `--hypothesis-profile=long`."""

import sys
from pathlib import Path

from hypothesis import HealthCheck, settings

sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

KEPT = {"deadline": None, "database": None, "suppress_health_check": list(HealthCheck)}
settings.register_profile("quick", max_examples=20, derandomize=True, **KEPT)
settings.register_profile("long", max_examples=2000, **KEPT)
settings.load_profile("quick")  # an option of pytest is read afterwards
