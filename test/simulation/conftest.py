"""Makes the helpers here and beside the rooms importable; tests are imported without a package."""

import sys
from pathlib import Path

sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parent)]
