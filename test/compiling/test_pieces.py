"""What importing the compiling room does to the process."""

import subprocess
import sys

SCRIPT = """
import warnings
import dlo_sim.compiling.pieces
from numba import NumbaExperimentalFeatureWarning as Kind
warnings.warn("\\x1b[1mFirst-class function type feature is experimental", Kind)
warnings.warn("another", Kind)
"""


def test_the_warning_about_function_types_is_silent_in_colour_too():
    made = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True
    )
    assert "First-class" not in made.stderr
    assert "another" in made.stderr
