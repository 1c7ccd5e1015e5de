"""`python -m dlo_sim` is the command `dlo_sim`."""

import sys

from dlo_sim.cli.main import main

sys.exit(main())
