"""The progress bar, on a terminal that is made up; JSON."""

import io
import json
import math
import re
import time
from contextlib import redirect_stderr

import numpy as np
import pytest

from dlo_sim.cli import output
from dlo_sim.process import stopping

SOON = 20.0  # [s]


class Terminal(io.StringIO):
    """What a terminal has been sent."""

    def isatty(self) -> bool:
        return True

    def shows(self, pattern: str) -> bool:
        """Wait until it shows this."""
        end = time.monotonic() + SOON
        while time.monotonic() < end:
            if re.search(pattern, self.getvalue()):
                return True
        return False


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setattr(output, "_REFRESH", 1e-3)
    return Terminal()


def test_a_bar_with_the_time_left_that_goes_on_between_two_pieces(terminal):
    with redirect_stderr(terminal), output.progress_bar("tune") as progress:
        assert terminal.shows(r"tune: preparing, 00:0\d")
        for fraction in (0.1, 0.25, 0.5):
            progress(fraction)
            assert terminal.shows(
                rf"{100 * fraction:.0f} % \|[#█]+.? +\| 00:0\d, (00:\d\d|\?) left"
            )
        assert terminal.shows("00:01, "), "time goes on although nothing is done"
    assert re.search(r"\r +\r$", terminal.getvalue()), "the bar is wiped"


def test_a_line_is_told_above_the_bar(terminal):
    with redirect_stderr(terminal), output.progress_bar("tune"):
        output.tell("compiling")
        assert terminal.shows(r"\rdlo_sim: compiling\n\r?tune: preparing")


def test_a_signal_ends_the_work_between_two_pieces(terminal, monkeypatch):
    with redirect_stderr(terminal), output.progress_bar("tune") as progress:
        progress(0.25)
        monkeypatch.setattr(stopping, "_requested", 15)
        with pytest.raises(KeyboardInterrupt):
            progress(0.5)


def test_json_is_strict_where_numbers_are_not_finite(capsys):
    numbers = {"a": math.nan, "b": [math.inf, np.int64(3)], "c": {"d": np.float64(1.5)}, "e": None}
    output.print_json(numbers)
    line = capsys.readouterr().out
    assert json.loads(line, parse_constant=pytest.fail) == {
        **{"a": None, "b": [None, 3], "c": {"d": 1.5}, "e": None}
    }
