"""Numbers as colours."""

import numpy as np
import pytest

from dlo_sim.core.color_scale import TABLE, colors


def test_ends_middle_and_beyond():
    found = colors(np.array([-5.0, 0.0, 1.0, 2.0, 9.0]), 0.0, 2.0)
    assert found[:, :3] == pytest.approx(np.array(TABLE)[[0, 0, 4, 8, 8]])
    assert np.all(found[:, 3] == 1.0)


def test_range_of_the_values_themselves_and_equal_values():
    assert np.array_equal(colors(np.array([3.0, 7.0]))[:, :3], [TABLE[0], TABLE[-1]])
    assert np.array_equal(colors(np.array([3.0, 3.0]))[:, :3], [TABLE[0], TABLE[0]])


def test_lightness_rises_evenly():
    """CIE L* of sRGB colours, D65."""
    rgb = np.array(TABLE)
    linear = np.where(rgb > 0.04045, ((rgb + 0.055) / 1.055) ** 2.4, rgb / 12.92)
    lightness = 116.0 * np.cbrt(linear @ [0.2126, 0.7152, 0.0722]) - 16.0
    assert np.diff(lightness) == pytest.approx(np.diff(lightness).mean(), rel=0.15)
