"""A term that is left out automatically does not matter: the full model moves in the same way."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from cables import SOFT, scene_of, set_state, simulator

from dlo_sim.engine.arrays import DAMPED
from dlo_sim.simulation.simulator import Simulator

STEPS = 50
ROUND_OFF = 1e-12  # [m, rad] after 25 ms of motion over more than a millimetre
# Clamped at the start, free at the end, in space; everything else is for the cases to put in.
BARE = SOFT | {"loads.names": [], "terms.gravity": "auto", "terms.twist": "auto"}
SPATIAL = {"terms.out_of_plane": "on"}
PLANES = {"yz": 0, "xz": 1, "xy": 2}
DIRECTIONS = {0: [0.0, 0.8, 0.6], 1: [0.8, 0.0, 0.6], 2: [0.6, 0.8, 0.0]}


@dataclass(frozen=True)
class Rule:
    """A scene that does without a term, what puts the term in, and how far the motions may differ
    [m, rad].

    material: values of both cables that no scene file may have.
    """

    term: str
    scene: dict
    forced: dict
    tolerance: float = ROUND_OFF
    method: str = "velocity_verlet"
    name: str = ""
    material: dict = field(default_factory=dict)

    def __str__(self):
        return self.name or self.term


def plane(name):
    """A cable with weight, a spring and a force in a coordinate plane."""
    normal = PLANES[name]
    along, axis = np.array(DIRECTIONS[normal]), np.eye(3)[normal]
    across = np.cross(axis, along)
    scene = BARE | {
        "terms.out_of_plane": "off",
        "end.position": list(along),
        "end.spring": [0.0 if d == normal else 20.0 + d for d in range(3)],
        "gravity": list(-9.81 * across),
        "loads.names": ["tip"],
        "loads.tip.position": 0.7,
        "loads.tip.signal": "constant",
        "loads.tip.force": list(0.4 * across - 0.3 * along),
    }
    return Rule("out_of_plane", scene, SPATIAL, name=f"out_of_plane {name}")


SPACE = BARE | SPATIAL
NOTHING = {"youngs_modulus": 0.0}
NO_WEIGHT = {"gravity": [0.0, 0.0, 0.0]}
ZERO_LOAD = {"loads.names": ["tip"], "loads.tip.type": "force", "loads.tip.signal": "constant"}
RULES = [
    Rule("stretch", SPACE, {"terms.stretch": "on"}, material=NOTHING | {"axial_stiffness": 0.0}),
    Rule("bend", SPACE, {"terms.bend": "on"}, material=NOTHING | {"bending_stiffness": 0.0}),
    Rule("gravity", SPACE | NO_WEIGHT, {"terms.gravity": "on"}),
    Rule("damping", SPACE, {"terms.damping": "on"}),
    Rule("damping", SPACE, {"terms.damping": "on"}, method="energy_momentum", name="friction"),
    Rule("plasticity", SPACE | {"terms.twist": "off"}, {"plasticity.yield_curvature": 1e5}),
    Rule("springs", SPACE | {"end.position": [1.0, 0.0, 0.0]}, {"end.spring": [1e-12] * 3}),
    Rule("loads", SPACE, ZERO_LOAD),
    Rule("drive", SPACE | {"terms.twist": "off"}, {"start.pose_topic": "/pose"}),
    *(plane(name) for name in PLANES),
]


def contains(sim, term):
    if term == "out_of_plane":
        return len(sim.model.axes) == 3
    there = term in sim.active_terms
    if term == "damping":
        assert there == sim.model.has(DAMPED)
    return there


def built(rule, more):
    scene = scene_of(rule.scene, more, n=6, method=rule.method, step=5e-4)
    return Simulator(replace(scene, cable=replace(scene.cable, **rule.material)))


def set_moving(sim, axes):
    """Throw the cable, along these axes only."""
    rates = np.zeros((sim.model.n, 4))
    rates[2:, axes] = 0.5 * np.random.default_rng(3).normal(size=(sim.model.n - 2, 3))[:, axes]
    set_state(sim, rates=rates)


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_what_is_left_out_does_not_matter(rule):
    bare, full = built(rule, {}), built(rule, rule.forced)
    assert not contains(bare, rule.term) and contains(full, rule.term)
    assert rule.term in bare.left_out and rule.term not in full.left_out
    assert bare.warnings == full.warnings == ()
    begin = bare.control_points
    assert np.abs(full.control_points - begin).max() < ROUND_OFF
    for sim in (bare, full):
        set_moving(sim, list(bare.model.axes))
        assert sim.advance_steps(STEPS).status.ok
    assert np.abs(bare.control_points - begin)[:, :3].max() > 1e-3
    assert np.abs(full.control_points - bare.control_points).max() < rule.tolerance


def test_twist_is_there_where_a_moment_may_come_and_else_it_is_refused():
    """Until the moment comes the cable moves as without twist."""
    common = {"n": 6, "method": "energy_momentum", "step": 5e-4}
    given = SPACE | {"loads.names": ["tip"]}
    bare = simulator(SPACE, ZERO_LOAD, **common)
    sim, full = (simulator(given, more, **common) for more in ({}, {"terms.twist": "quasistatic"}))
    assert "twist" in bare.left_out and "twist" in sim.active_terms
    for each in (bare, sim, full):
        set_moving(each, [0, 2])
        assert each.advance_steps(STEPS).status.ok
    assert np.abs(sim.control_points - bare.control_points).max() < ROUND_OFF
    points, moment = bare.control_points, [0.02, 0.0, 0.01]
    with pytest.raises(ValueError, match=r"torque of tip: .* set loads.tip.type to wrench"):
        bare.set_load("tip", torque=moment)
    assert np.array_equal(bare.control_points, points) and not bare.cable.loads[:, 3:].any()
    for each in (sim, full):
        each.set_load("tip", torque=moment)
        assert each.advance_steps(STEPS).status.ok
    assert np.abs(sim.control_points[:, 3]).max() > 1e-2
    assert np.array_equal(sim.control_points, full.control_points)
