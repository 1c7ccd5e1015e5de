"""Numbers of random examples: few in every test run, many with `--hypothesis-profile=long`."""

from hypothesis import HealthCheck, settings

KEPT = {"deadline": None, "database": None, "suppress_health_check": list(HealthCheck)}
settings.register_profile("quick", max_examples=20, derandomize=True, **KEPT)
settings.register_profile("long", max_examples=2000, **KEPT)
settings.load_profile("quick")  # an option of pytest is read afterwards
