"""Fits to simulated cables: the truth lies in the intervals, and what cannot be told is said."""

import numpy as np
import pytest
from simulated_cables import TRUTH, recorded

import dlo_sim
from dlo_sim.batch.workers import HERE
from dlo_sim.identification.fit import WIDE, FitError
from dlo_sim.identification.identify import identify
from dlo_sim.scene.refusal import SceneError

pytest.importorskip("scipy")
KEYS = ("cable.bending_stiffness", "damping.stiffness", "cable.length")
START = {"cable.bending_stiffness": 6e-3, "damping.stiffness": 0.03}


def identified(recordings, keys=KEYS, left_out=0.0, asked=None, **changes):
    said = []
    asked = {key: value for key, value in TRUTH.items() if key not in keys} | (asked or {})
    scene = dlo_sim.load_scene({**TRUTH, **START, **changes})
    found = identify(
        scene, asked, recordings, HERE, keys, left_out, 5.0, lambda share: None, said.append
    )
    return found, said


def test_the_truth_is_found_and_lies_in_the_intervals(moving):
    found, said = identified(moving)
    assert not said
    assert len(found.fit.numbers) == 3
    for number in found.fit.numbers:
        truth = TRUTH[number.unknown.key]
        assert number.value == pytest.approx(truth, rel=0.1)
        width = number.high - number.low
        assert number.low - 0.5 * width < truth < number.high + 0.5 * width
        assert width < 0.4 * truth
    assert found.scene.cable.bending_stiffness == found.fit.numbers[0].value


def test_a_second_plane_of_natural_curvature_is_fitted_where_asked_for():
    truth = {**TRUTH, "cable.rest_curvature_2": [3.0]}
    piece = recorded(truth, noise=2e-4)
    found, _ = identified([piece], ("cable.rest_curvature_2",))
    assert {number.unknown.key for number in found.fit.numbers} == {"cable.rest_curvature_2"}
    assert found.scene.cable.rest_curvature_2 == pytest.approx([3.0] * 7, abs=0.3)


def test_torsional_stiffness_starts_in_proportion_to_bending_stiffness():
    """Both are a hundred times too small at first. With so little torsional stiffness the natural
    shape rolls freely and nothing tells it.
    """
    bent = {"cable.rest_curvature": [5.0, -3.0, 4.0], "cable.torsional_stiffness": 1.4e-3}
    truth = {**TRUTH, **bent, "terms.twist": "quasistatic"}
    pieces = [recorded(truth, seed, noise=2e-4) for seed in (1, 2)]
    keys = ("cable.bending_stiffness", "cable.torsional_stiffness", "cable.rest_curvature")
    soft = {"cable.bending_stiffness": 2e-5, "cable.torsional_stiffness": 1.4e-5}
    found, said = identified(pieces, keys, asked={"terms.twist": "quasistatic"}, **soft)
    assert not said
    assert found.scene.cable.bending_stiffness == pytest.approx(2e-3, rel=0.1)
    assert found.scene.cable.torsional_stiffness == pytest.approx(1.4e-3, rel=0.3)
    assert found.scores["training pieces"].distance < 1e-3


@pytest.mark.parametrize("thinning", [0.1, 0.0])
def test_thinning_is_told_from_damping(thinning):
    truth = {**TRUTH, "damping.stiffness": 0.12, "damping.thinning": thinning}
    pieces = [recorded(truth, seed, amount, noise=2e-4) for seed, amount in enumerate((0.4, 1.0))]
    found, _ = identified(pieces, ("damping.stiffness", "damping.thinning"))
    assert found.scene.damping.stiffness == pytest.approx(0.12, rel=0.05)
    assert found.scene.damping.thinning == pytest.approx(thinning, rel=0.2, abs=3e-3)


SLIP = {"plasticity.yield_curvature": 1.0, "plasticity.hardening": 0.4}


def test_slip_is_told_from_stiffness_and_damping():
    """Small motion is stiff, large motion soft; the start is an elastic cable."""
    truth = {**TRUTH, **SLIP, "cable.bending_stiffness": 4e-3, "damping.stiffness": 0.02}
    pieces = [recorded(truth, seed, amount, noise=2e-4) for seed, amount in enumerate((0.3, 1.0))]
    found, said = identified(pieces, ("cable.bending_stiffness", "damping.stiffness", *SLIP))
    assert not said
    assert found.scene.cable.bending_stiffness == pytest.approx(4e-3, rel=0.1)
    assert found.scene.plasticity.yield_curvature == pytest.approx(1.0, rel=0.1)
    assert found.scene.plasticity.hardening == pytest.approx(0.4, abs=0.04)
    # What slipped before the first frame is not measured, and friction keeps it.
    assert found.scores["training pieces"].distance < 3e-3


def test_a_fit_goes_on_from_a_cable_that_slips():
    """The grid of starts stays within the range of the hardening."""
    truth = {**TRUTH, **SLIP, "plasticity.hardening": 0.2}
    piece = recorded(truth, noise=2e-4)
    near = {"plasticity.yield_curvature": 0.8, "plasticity.hardening": 0.15}
    found, _ = identified([piece], (*SLIP,), **near)
    assert found.scene.plasticity.hardening == pytest.approx(0.2, abs=0.05)
    assert found.scene.plasticity.yield_curvature == pytest.approx(1.0, rel=0.2)


def test_an_elastic_cable_is_found_hardly_to_slip(moving):
    found, _ = identified(moving[:1], ("cable.bending_stiffness", *SLIP))
    assert found.scene.cable.bending_stiffness == pytest.approx(2e-3, rel=0.05)
    assert found.scores["training pieces"].distance < 3e-3


def test_a_number_that_is_left_stays_where_thinning_joins(moving):
    """A cable at rest tells no damping; the grid of thinnings must not change it."""
    still = recorded(TRUTH, amount=0.0, noise=2e-4)
    keys = ("cable.bending_stiffness", "damping.stiffness", "damping.thinning")
    found, _ = identified([still], keys)
    assert set(found.fit.left) == {"damping.stiffness", "damping.thinning"}
    assert found.scene.damping.stiffness == START["damping.stiffness"]
    assert found.fit.seen[1:] == pytest.approx([np.log(START["damping.stiffness"]), 0.0])


def test_left_out_pieces_are_predicted_as_well(moving):
    found, _ = identified(moving, left_out=0.5)
    assert (found.pieces, found.left_out) == (2, 1)
    training, left_out, _ = found.scores.values()
    # Noise of 1 mm is 1.6 mm of distance; that of two frames is also a start's velocity.
    assert training.distance < 3e-3
    assert left_out.distance < 5e-3


def test_a_cable_at_rest_tells_no_damping():
    still = recorded(TRUTH, amount=0.0, duration=1.5, noise=2e-4)
    found, said = identified([still])
    assert set(found.fit.left) == {"damping.stiffness"}
    assert any("damping.stiffness is left at its value" in line for line in said)
    assert found.scene.damping.stiffness == START["damping.stiffness"]


def test_a_number_that_may_be_anywhere_is_left_after_the_fit(monkeypatch):
    """The drag of a cable at rest, where the check before the fit knows of no noise."""
    monkeypatch.setattr("dlo_sim.identification.problem.MARKER_NOISE", 1e-9)
    keys = ("cable.bending_stiffness", "damping.air_drag")
    still = recorded(TRUTH, amount=0.0, noise=2e-4)
    found, said = identified([still], keys, **{"damping.air_drag": 0.03})
    assert found.fit.left == {"damping.air_drag": WIDE}
    assert said == [f"damping.air_drag is left at its value: {WIDE}"]
    assert found.scene.damping.air_drag == 0.03


def test_twins_are_told_from_each_other_by_nothing(moving):
    """Drag and a damping of the same effect cannot both be known; here the torsional stiffness."""
    found, _ = identified(moving[:1], keys=("cable.torsional_stiffness", "cable.bending_stiffness"))
    assert "cable.torsional_stiffness" in found.fit.left


def test_scipy_is_named_where_it_is_missing(moving, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(FitError, match="extra 'identify'"):
        identified(moving)


@pytest.mark.parametrize(
    ("keys", "asked", "words"),
    [
        (["rate"], {}, r"--fit rate cannot be fitted; give one of cable\."),
        (["plasticity.hardening"], {}, "plasticity.hardening: the scene has no yield curvature"),
        (SLIP, {"terms.plasticity": "off"}, "terms.plasticity is off"),
        (
            ["damping.stiffness", "damping.thinning"],
            {"integrator.method": "implicit_midpoint"},
            "implicit_midpoint is not valid with damping.thinning",
        ),
    ],
)
def test_keys_that_cannot_be_fitted_are_refused(moving, keys, asked, words):
    with pytest.raises((FitError, SceneError), match=words):
        identified(moving, tuple(keys), asked=asked)
