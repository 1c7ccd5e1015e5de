"""The command `dlo_sim`: one file per subcommand; it converts arguments, calls one room, prints.

Heavy imports happen inside the subcommands, so that `dlo_sim --help` answers at once.
"""

REFUSED, FAILED = 2, 3  # exit statuses beside 0 and those of signals
