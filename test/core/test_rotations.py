"""Quaternion helpers against rotation matrices, and at the angles where formulas break down."""

import numpy as np
import pytest

from dlo_sim.core import rotations as r


def random_quaternions(n, seed=3):
    return r.normalized(np.random.default_rng(seed).normal(size=(n, 4)))


def axis_matrix(axis, angle):
    """Rodrigues' formula, written out independently."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def test_quarter_turn_about_z_takes_x_to_y():
    q = r.from_rotation_vector([0, 0, np.pi / 2])
    assert np.allclose(q, [0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    assert np.allclose(r.rotate(q, [1, 0, 0]), [0, 1, 0])


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 9e-5, 1.1e-4, 0.3, 2.0, np.pi - 1e-6])
def test_rotation_vector_matches_rodrigues_and_comes_back(angle):
    axis = np.array([0.36, -0.48, 0.8])
    q = r.from_rotation_vector(angle * axis)
    assert np.allclose(r.to_matrix(q), axis_matrix(axis, angle), atol=1e-15)
    assert np.allclose(r.to_rotation_vector(q), angle * axis, rtol=1e-9, atol=1e-16)
    assert np.allclose(r.to_rotation_vector(-q), angle * axis, rtol=1e-9, atol=1e-16)


@pytest.mark.parametrize("shape", [(3,), (1, 3)])
def test_the_series_for_small_angles_joins_the_closed_form(shape):
    """|exp(w) - (w/2, 1)| to third order: 0.5 - a^2/48, just below the change of formula."""
    w = 9e-5 * np.array([0.36, -0.48, 0.8]).reshape(shape)
    expected = w / 9e-5 * np.sin(4.5e-5)
    assert np.allclose(r.from_rotation_vector(w)[..., :3], expected, rtol=1e-15, atol=0.0)
    assert np.allclose(r.to_rotation_vector(r.from_rotation_vector(w)), w, rtol=1e-15, atol=0.0)


def test_multiply_applies_the_right_factor_first():
    a, b = random_quaternions(50, 1), random_quaternions(50, 2)
    product = r.to_matrix(r.multiply(a, b))
    assert np.allclose(product, r.to_matrix(a) @ r.to_matrix(b))
    assert np.allclose(r.multiply(a, r.conjugate(a)), [0, 0, 0, 1])


def test_from_matrix_inverts_to_matrix_also_at_half_turns():
    half_turns = np.eye(4)[:3]  # about x, y, z: the trace formula divides by zero here
    q = np.concatenate([random_quaternions(50), half_turns, [[0, 0, 0, 1.0]]])
    back = np.array([r.from_matrix(matrix) for matrix in r.to_matrix(q)])
    assert np.allclose(np.abs(np.sum(q * back, axis=-1)), 1.0)
    assert np.all(back[:, 3] >= 0)


def test_slerp_ends_middle_and_shorter_way():
    a, b = r.from_rotation_vector([0, 0, 0.2]), -r.from_rotation_vector([0, 0, 0.6])
    assert np.allclose(r.slerp(a, b, 0.0), a)
    assert np.allclose(r.slerp(a, b, 0.5), r.from_rotation_vector([0, 0, 0.4]))
    assert np.allclose(np.abs(np.dot(r.slerp(a, b, 1.0), b)), 1.0)
    assert r.slerp(a, b, [0.0, 0.25, 1.0]).shape == (3, 4)


def test_minimal_rotation_takes_u_to_v_by_the_angle_between_them():
    rng = np.random.default_rng(5)
    u, v = rng.normal(size=(100, 3)), rng.normal(size=(100, 3))
    q = r.minimal_rotation(u, v)
    unit_u = u / np.linalg.norm(u, axis=1, keepdims=True)
    unit_v = v / np.linalg.norm(v, axis=1, keepdims=True)
    assert np.allclose(r.rotate(q, unit_u), unit_v)
    between = np.arccos(np.sum(unit_u * unit_v, axis=1))
    assert np.allclose(np.linalg.norm(r.to_rotation_vector(q), axis=1), between)


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-7, 1e-3])
@pytest.mark.parametrize("u", np.eye(3))
def test_minimal_rotation_of_nearly_opposite_directions(u, off):
    v = -u + off * np.roll(u, 1)
    q = r.minimal_rotation(u, v)
    assert np.linalg.norm(q) == pytest.approx(1.0)
    assert np.allclose(r.rotate(q, u), v / np.linalg.norm(v), atol=2e-8)


def test_one_at_a_time_gives_what_many_at_once_give():
    rng = np.random.default_rng(7)
    w = rng.normal(size=(40, 3)) * np.logspace(-7, 0.3, 40)[:, None]
    q, p = r.from_rotation_vector(w), random_quaternions(40)
    for one, many in [
        ([r.from_rotation_vector(x) for x in w], q),
        ([r.to_rotation_vector(x) for x in q], r.to_rotation_vector(q)),
        ([r.to_rotation_vector(-x) for x in q], r.to_rotation_vector(q)),
        ([r.multiply(x, y) for x, y in zip(q, p, strict=True)], r.multiply(q, p)),
        ([r.multiply(x, p[0]) for x in q], r.multiply(q, p[0])),
        ([r.rotate(x, y) for x, y in zip(q, w, strict=True)], r.rotate(q, w)),
    ]:
        assert np.allclose(one, many, rtol=1e-14, atol=1e-22)


def test_what_is_no_rotation_is_refused():
    with pytest.raises(ValueError, match="zero or not finite"):
        r.normalized([0, 0, 0, 0])
    with pytest.raises(ValueError, match="zero or not finite"):
        r.normalized([np.nan, 0, 0, 1])
    with pytest.raises(ValueError, match="direction"):
        r.minimal_rotation([0, 0, 0], [1, 0, 0])
