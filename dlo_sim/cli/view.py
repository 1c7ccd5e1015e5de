"""`dlo_sim view RUN`: a run to look at, as a page, a film or a picture."""

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dlo_sim.cli.arguments import CommandError, Parser, add_scene, needing_plots, read_scene
from dlo_sim.cli.output import check_output_file, print_json, print_rows, progress_bar, write_whole

if TYPE_CHECKING:
    from dlo_sim.view.run import Run

_SUFFIXES = {"html": ".html", "gif": ".gif", "mp4": ".mp4", "png": ".png", "plots": "_plots.png"}

HELP = "show a run as a web page that plays it in 3D, a film, a still or plots"


def add_arguments(parser: Parser) -> None:
    """Say what the subcommand does and takes."""
    parser.description = (
        "Make a web page that plays a run in 3D, with plots, and needs only a browser; or make a "
        "film, a still or plots. Works without a display."
    )
    text = "npz of dlo_sim simulate, or a bag with control points from replay or the node"
    parser.option("run_path RUN", text, type=Path)
    text = (
        "file to write (default: the name of the run with the suffix of the format, in the "
        "current folder)"
    )
    parser.option("--output FILE", text, type=Path)
    text = (
        "png is a still of the motion, plots a png of all quantities over time (default: by the "
        "suffix of --output, else html)"
    )
    parser.option("--format", text, choices=tuple(_SUFFIXES))
    text = "scene of a bag, needed for the tension and for discretization.knots auto"
    add_scene(parser, "--params", text)
    parser.option("--node NAME", "full name of the node, if the bag has several", default="")


def run(options: argparse.Namespace) -> int:
    """Read, write and print; returns the exit status."""
    path: Path = options.run_path
    kind = _format(options.format, options.output)
    output: Path = options.output or Path(path.resolve().stem + _SUFFIXES[kind])
    check_output_file(output)
    scene = read_scene(options) if options.scene else None

    from dlo_sim.view.run import read_run

    with progress_bar("view") as progress:
        seen = read_run(path, scene, options.node)
        write_whole(output, partial(_writer(kind, progress), seen))
    frames, span = len(seen.time), float(seen.time[-1] - seen.time[0])
    if options.json:
        print_json({"output": str(output), "format": kind, "times": frames, "duration_s": span})
    else:
        print(f"{path}: {frames} times in {span:g} s")
        print_rows({"output": f"{output} ({output.stat().st_size / 1e3:.0f} kB)"})
    return 0


def _format(wanted: str | None, output: Path | None) -> str:
    """The format that is meant."""
    if wanted or output is None:
        return wanted or "html"
    kind = output.suffix.removeprefix(".").lower()
    if kind not in _SUFFIXES:
        raise CommandError(
            f"--output {output} ends with no format that there is; end it with .html, .gif, .mp4 "
            "or .png, or give --format"
        )
    return kind


def _writer(kind: str, progress: Callable[[float], None]) -> Callable[["Run", Path], None]:
    """Writes a run in this format to a path."""
    from dlo_sim.view.page import write_page

    if kind == "html":
        return write_page
    with needing_plots(f"--format {kind} needs matplotlib; pip install matplotlib, or make html"):
        from dlo_sim.view.film import NoFilm, write_film, write_plots, write_still

    def film(run: "Run", path: Path) -> None:
        try:
            write_film(run, path, kind, progress)
        except NoFilm as refusal:
            raise CommandError(f"--format {kind}: {refusal}") from None

    return {"png": write_still, "plots": write_plots}.get(kind, film)
