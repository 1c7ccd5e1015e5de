"""Makes the helpers beside the rooms importable; tests are imported without a package."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
