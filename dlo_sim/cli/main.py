"""Entry point of the command `dlo_sim`: arguments in, a subcommand run, refusals as one line.

Exit status: 0 done; 2 refused input (one line on stderr, nothing written); 3 the run failed: it
diverged or missed its accuracy, a bag is damaged or more than 5 % of a topic were refused, the disk
filled up under a replay (what was good is kept); 128 + its number for a signal: 130 interrupted,
143 terminated. Anything else is a defect and shows its traceback.
"""

import errno
import os
import sys
from collections.abc import Sequence
from importlib import import_module

from dlo_sim import __version__
from dlo_sim.batch.workers import WorkerLost
from dlo_sim.cli import FAILED, REFUSED, node
from dlo_sim.cli.arguments import CommandError, Parser
from dlo_sim.scene.refusal import Refusal, one_line

# Cures for names that the system refuses, and for what else keeps a file from being written.
_NAMES = dict.fromkeys(
    (errno.ENAMETOOLONG, errno.ELOOP, errno.EILSEQ), "give a name that the system can have"
)
_DISKS = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), "free space"),
    **dict.fromkeys((errno.EROFS, errno.EACCES, errno.EPERM), "choose another folder"),
    **dict.fromkeys((errno.EMFILE, errno.ENFILE), "raise the limit of open files (ulimit -n)"),
    errno.EIO: "check the disk",
}

_LOOP = "Symlink loop"  # begins what Path.resolve says of one, until Python 3.12

_NAMED = (
    *("demo", "doctor", "simulate", "replay", "forecast", "view", "identify"),
    *("study", "tune", "node", "methods", "parameters"),
)
SUBCOMMANDS = {name: import_module(f"dlo_sim.cli.{name}") for name in _NAMED}


def main(argv: Sequence[str] | None = None) -> int:
    """Run `dlo_sim` with these arguments (default: the process's); returns the exit status.

    Raises:
        KeyboardInterrupt: a signal asked for the end; `supervised` says so.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        return _run(arguments)
    except Refusal as refusal:
        return _ended(REFUSED, str(refusal))
    except WorkerLost as loss:
        return _ended(FAILED, str(loss))
    except BrokenPipeError:
        # The reader of our output has gone; keep Python from complaining when it flushes stdout.
        _let_stdout_go()
        return 0
    except OSError as error:
        if not _has_folder():
            return _ended(REFUSED, "the current folder is gone; change to one that exists")
        cure = _NAMES.get(error.errno or 0) or _DISKS.get(error.errno or 0)
        if cure is None:
            raise
        where = os.fsdecode(error.filename or "standard output")
        if not error.filename:  # every writer of files names them
            _let_stdout_go()
        status = REFUSED if error.errno in _NAMES else FAILED
        return _ended(status, f"{where}: {error.strerror}; {cure}")
    except RuntimeError as error:
        if not str(error).startswith(_LOOP):
            raise
        return _ended(REFUSED, f"{error}; give another name")


def _ended(status: int, why: str) -> int:
    print(f"dlo_sim: error: {one_line(why)}", file=sys.stderr)
    return status


def _has_folder() -> bool:
    try:
        os.getcwd()
    except OSError:
        return False
    return True


def _let_stdout_go() -> None:
    """What is still to be written there goes nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _run(arguments: list[str]) -> int:
    if arguments[:1] == ["node"]:
        return node.run_node(arguments[1:])
    options = _parser().parse_args(arguments)
    if getattr(options, "assignments", ()) and not options.scene:
        raise CommandError(f"--set changes a scene; give {options.scene_words}, too")
    status: int = options.run(options)
    sys.stdout.flush()
    return status


def _parser() -> Parser:
    parser = Parser(
        prog="dlo_sim",
        description="Simulate and predict the motion of a cable, live and from bags.",
        epilog="Start with 'dlo_sim demo'.",
    )
    parser.add_argument("--version", action="version", version=f"dlo_sim {__version__}")
    subparsers = parser.add_subparsers(
        title="subcommands", metavar="SUBCOMMAND", required=True, parser_class=Parser
    )
    for name, subcommand in SUBCOMMANDS.items():
        its_parser = subparsers.add_parser(name, help=subcommand.HELP)
        subcommand.add_arguments(its_parser)
        its_parser.add_argument(
            "--json", action="store_true", help="print one JSON object as the last line of stdout"
        )
        its_parser.set_defaults(run=subcommand.run)
    return parser
