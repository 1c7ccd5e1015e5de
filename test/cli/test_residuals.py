"""Plots of residuals: names of recordings are shown as they are."""

from types import SimpleNamespace

import numpy as np
import pytest


def test_a_name_with_dollar_signs_is_no_formula(tmp_path):
    pytest.importorskip("matplotlib")
    from dlo_sim.cli.residuals import _of_markers

    name = r"$\frac$"
    piece = SimpleNamespace(
        name=name, markers=np.zeros((4, 3, 3)), shares=np.linspace(0.1, 0.9, 3), times=np.arange(4)
    )
    predicted = SimpleNamespace(markers=np.ones((4, 3, 3)))
    found = SimpleNamespace(recordings=[piece], predicted=[predicted], left_out=0)
    figure = _of_markers(found)
    legend = figure.axes[1].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == [name]
    figure.savefig(tmp_path / "figure.png")  # refuses formulas that are none
    assert (tmp_path / "figure.png").stat().st_size > 1000
