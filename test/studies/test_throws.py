"""Throws of `study contact`: what passes through is found without the simulator's contact."""

import numpy as np
import pytest

from dlo_sim.studies.throws import (
    KINDS,
    Throw,
    judged,
    swept,
    thrown,
    thrown_at_another,
    throws_of_two,
)

OFF = {"box": "terms.contact", "sphere": "terms.contact", "edge": "terms.contact"}


@pytest.mark.parametrize("number", [16, 5, 6, 7])
def test_a_throw_passes_through_only_without_contact(number):
    kind = KINDS[number % 4]
    hit = thrown(number, {})
    assert hit.kind == kind and hit.hit and hit.finite and not hit.passed
    assert hit.energy < 1e-5
    through = thrown(number, {OFF.get(kind, "contact.self_contact"): "off"})
    assert through.passed and not through.hit


def test_cables_thrown_at_each_other_pass_only_without_contact(number=1):
    assert all(one.meets for one in throws_of_two(12).answers)
    through = thrown_at_another(number, {"contact.self_contact": "off"})
    assert through.passed and not through.hit


def test_smooth_contact_keeps_momentum():
    """All of it at itself, the moment about a sphere, and what is along a bar."""
    assert thrown(7, {}).momentum < 1e-12
    assert thrown(13, {"contact.friction": 0.0}).momentum < 1e-7
    assert thrown(18, {"contact.friction": 0.0}).momentum < 1e-3
    assert thrown(16, {}).momentum is None  # a box keeps none


def test_no_answer_is_met_by_nan_or_by_throws_that_all_fail():
    good = Throw("sphere", False, True, True, 0.0, 0.0, 1.0)
    found = [good, good._replace(kind="itself"), good._replace(kind="edge")]
    found.append(good._replace(kind="box", momentum=None))
    assert all(one.meets for one in judged(4, found, 0).answers)
    for wrong in ({"energy": np.nan}, {"momentum": np.nan}):
        assert (
            sum(not one.meets for one in judged(5, [*found, good._replace(**wrong)], 0).answers)
            == 1
        )
    missed = [not one.meets for one in judged(3, [], 3).answers]
    assert missed == [False, True, False, True, True, True, True]


def test_a_swept_surface_meets_a_needle_once_it_is_over_it():
    line = np.linspace([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], 9)
    needle = np.array([[[0.1, 0.0, -0.5], [0.1, 0.4, -0.5]]])
    assert not swept(line + [0.0, 0.2, 1.0], line + [0.0, 0.2, -0.4], needle)
    assert swept(line + [0.0, 0.2, 1.0], line + [0.0, 0.2, -0.6], needle)
    assert not swept(line + [0.0, 0.5, 1.0], line + [0.0, 0.5, -0.6], needle)
