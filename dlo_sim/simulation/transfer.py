"""Plastic and natural curvature of one cable at the samples of another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.engine.arrays import MATERIAL, PLASTICITY
from dlo_sim.simulation.cable import Cable

Array = NDArray[np.float64]
TINY = 1e-300


def carry_samples(old: Cable, new: Cable) -> None:
    """Take over another cable's plastic curvature, and its natural shape where that follows the
    material frame.
    """
    if old.model.has(PLASTICITY) and new.model.has(PLASTICITY):
        plastic = _carried_over(old, new, old.plastic)
        # p / (1 - h), from which strands have slipped, stays.
        plastic[..., :3] *= (1.0 - new.model.elastic_share) / (1.0 - old.model.elastic_share)
        new.plastic = plastic
        new.flow()
    if old.model.has(MATERIAL) and new.model.has(MATERIAL):
        natural = old.natural
        weights = old.model.elastic_share * old.model.moment_weights
        natural[..., :3] /= np.maximum(weights, TINY)
        natural = _carried_over(old, new, natural)
        natural[..., :3] *= new.model.elastic_share * new.model.moment_weights
        new.natural = natural


def _carried_over(old: Cable, new: Cable, values: Array) -> Array:
    """Values (spans, samples, rows) of one cable at the samples of another, linear between them."""
    source, target = old.model.sample_shares, new.model.sample_shares
    known = old.model.rule.weights != 0.0
    order = np.argsort(source[known], kind="stable")
    out = np.empty((*target.shape, values.shape[-1]))
    for row in range(values.shape[-1]):
        out[..., row] = np.interp(target, source[known][order], values[..., row][known][order])
    return out
