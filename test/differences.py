"""Derivatives against central differences over several steps."""

import numpy as np

STEPS = (1e-3, 1e-4, 1e-5, 1e-6)


def central(function, x, step):
    """d function / d x by central differences, shape (function's shape + x's shape)."""
    columns = []
    for index in np.ndindex(x.shape):
        above, below = x.copy(), x.copy()
        above[index] += step
        below[index] -= step
        columns.append((np.asarray(function(above)) - np.asarray(function(below))) / (2 * step))
    return np.stack(columns, axis=-1).reshape(np.shape(columns[0]) + x.shape)


def assert_limit(exact, function, x, *, bound, steps=STEPS, tiny=1e-11, rises=True):
    """Assert that differences of `function` tend to `exact`: the error falls with the step squared
    until it is below `bound` (relative to the largest entry), and rises again at the step `tiny`,
    unless `rises` says that the function is so close to zero that it has no round-off.

    One step size proves little: a factor that is wrong by 1e-4, or a function that does not depend
    on x, would pass at one of them.
    """
    size = np.abs(exact).max()
    assert size > 0.0
    errors = [np.abs(central(function, x, step) - exact).max() / size for step in steps]
    lowest = min(errors)
    assert lowest < bound, f"relative errors {errors}"
    for coarse, fine in zip(errors[:-1], errors[1:], strict=True):
        assert fine < 0.03 * coarse or fine < bound, f"relative errors {errors}"
    if rises:
        assert np.abs(central(function, x, tiny) - exact).max() / size > 3 * lowest
