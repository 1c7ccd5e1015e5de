"""The bending law: closed form of moment and curvature, cycles, energy, objectivity of the
carry."""

import numpy as np
import pytest
from plasticity import Law, carried

EI = 0.05
AXIS = np.array([0.0, 0.6, 0.8])


def bend_along(law: Law, path: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Moments about AXIS, plastic curvature and energy lost [J/m] on a path of curvatures."""
    plastic, lost, moments = np.zeros(3), 0.0, []
    for curvature in path:
        plastic, more = law.flow(curvature * AXIS, plastic)
        lost += more
        moments.append(law.EI * (curvature * AXIS - plastic) @ AXIS)
    return np.array(moments), plastic, lost


@pytest.mark.parametrize("hardening", [0.0, 0.1, 0.5])
def test_monotonic_bending_is_the_closed_form(hardening: float) -> None:
    law = Law(EI, 2.0, hardening)
    path = np.linspace(0.0, 10.0, 41)
    moments, _, _ = bend_along(law, path)
    np.testing.assert_allclose(moments, [law.moment(k) for k in path], rtol=1e-12, atol=1e-15)
    # the closed form in numbers: M_y, then the tangent h EI
    assert law.moment(2.0) == pytest.approx(0.1)
    assert law.moment(6.0) - law.moment(4.0) == pytest.approx(hardening * EI * 2.0)
    # rate independence: one stride ends where many small ones do
    assert bend_along(law, path[[0, -1]])[0][-1] == pytest.approx(moments[-1], rel=1e-12)


@pytest.mark.parametrize("hardening", [0.0, 0.2])
def test_unloading_is_elastic_and_leaves_the_set(hardening: float) -> None:
    law = Law(EI, 2.0, hardening)
    rest = law.set_after(5.0)
    assert rest == pytest.approx((1.0 - hardening) * 3.0)
    moments, plastic, _ = bend_along(law, np.concatenate((np.linspace(0, 5, 20), [4.0, rest])))
    assert moments[-2] - moments[-3] == pytest.approx(-EI * 1.0)
    assert moments[-1] == pytest.approx(0.0, abs=1e-15)
    assert plastic @ AXIS == pytest.approx(rest)
    with pytest.raises(ValueError, match="yields again"):
        Law(EI, 2.0, 0.6).set_after(20.0)


def test_reversal_yields_after_twice_the_yield_moment() -> None:
    law = Law(EI, 2.0, 0.2)
    path = np.concatenate((np.linspace(0.0, 5.0, 51), np.linspace(5.0, -5.0, 1001)))
    moments, _, _ = bend_along(law, path)
    back, slopes = path[51:], np.diff(moments[50:]) / np.minimum(np.diff(path[50:]), -1e-12)
    elastic = np.isclose(slopes, EI)
    assert back[elastic].min() == pytest.approx(5.0 - 2.0 * 2.0, abs=0.02)
    assert slopes[-1] == pytest.approx(0.2 * EI)


def test_work_is_stored_or_lost() -> None:
    law = Law(EI, 2.0, 0.2)
    rng = np.random.default_rng(0)
    corners = rng.normal(scale=6.0, size=(6, 3))
    path = np.concatenate(
        [
            a + (b - a) * s
            for a, b in zip(corners[:-1], corners[1:], strict=True)
            for s in [np.linspace(0, 1, 4000)[:, None]]
        ]
    )
    plastic, lost, work = np.zeros(3), 0.0, 0.0
    before = np.zeros(3)
    path = np.concatenate((np.linspace(0, 1, 4000)[:, None] * corners[0], path))
    moment = np.zeros(3)
    for curvature in path:
        plastic, more = law.flow(curvature, plastic)
        assert more >= 0.0
        lost += more
        after = EI * (curvature - plastic)
        work += 0.5 * (moment + after) @ (curvature - before)
        before, moment = curvature, after
    assert lost > 1.0
    assert work == pytest.approx(law.energy(before, plastic) + lost, rel=2e-3)


def test_carry_is_the_smallest_rotation() -> None:
    rng = np.random.default_rng(5)
    before, after = rng.normal(size=(2, 3))
    before, after = before / np.linalg.norm(before), after / np.linalg.norm(after)
    plastic = np.cross(before, rng.normal(size=3))
    moved = carried(plastic, before, after)
    assert moved @ after == pytest.approx(0.0, abs=1e-14)
    assert np.linalg.norm(moved) == pytest.approx(np.linalg.norm(plastic))
    axis = np.cross(before, after)
    assert moved @ axis == pytest.approx(plastic @ axis)
    np.testing.assert_allclose(carried(plastic, before, before), plastic, atol=1e-15)
