"""Scenes and calls that are refused: in one line, with words that name key, value and cure."""

import numpy as np
import pytest
import solids
from cables import FULL, MASS_DAMPED, SOFT, simulator
from test_bishop import SHAFT
from test_contact import ROD as FALLING
from test_contact_guides import CHANNEL, RING, THREADED
from test_contact_meshes import LYING as MESHED
from test_grasps import CABLE as GRASPED
from test_hose import HOSE
from test_jaws import MIDDLE
from test_jaws import ROD as JAWED
from test_natural_shape import HELD as NATURAL
from test_roll import HELD as ROLLED
from test_selection import WIRE
from test_self_contact import CABLE as COILED
from test_sliding import LYING as SLIDING
from test_water import CABLE as WET

from dlo_sim.core.methods import METHODS
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation import meshes

METHOD, STEP = "integrator.method", "integrator.step"
TABLE, GUIDE, HAND, BODY = "obstacles.table", "obstacles.guide", "grasps.hand", "obstacles.body"
YIELD = {"plasticity.yield_curvature": 1.5, "plasticity.hardening": 0.2}
DRAG = {"damping.air_drag": 0.05, "damping.air_drag_ratio": 0.5}
RODLIKE = SHAFT | ROLLED
BOX = {f"{BODY}.mesh": meshes.keep_triangles(solids.box(0.1, 0.1, 0.1)), f"{BODY}.mesh_cells": 48}
SPHERE = {f"{BODY}.mesh": meshes.keep_triangles(solids.sphere(0.1, 12)), f"{BODY}.mesh_cells": 48}
SPANS = {"discretization.stretch": "span"}
APART = {"end.position": [0.5, 0.0, 0.0]}
FREE_ENDS = {"start.fixed": [False] * 3, "end.fixed": [False] * 3, "start.clamped": False}
VERLET = {METHOD: "velocity_verlet"}
# Scene, changes, words.
SCENES = [
    (FALLING, {"obstacles.names": [], "terms.contact": "on"}, "terms.contact: 'on' needs obsta"),
    (FALLING, {f"{TABLE}.orientation": [0.0] * 4}, f"{TABLE}.orientation: .* is no rotation"),
    (FALLING, {f"{TABLE}.orientation": [1e-200, 0.0, 0.0, 0.0]}, "orientation: .* is no rotation"),
    (FALLING, {f"{TABLE}.shape": "cone"}, f"{TABLE}.shape: 'cone' is unknown"),
    (
        FALLING,
        {f"{TABLE}.shape": "box", f"{TABLE}.size": [1.0, 0.0, 1.0]},
        "table.size: .* has a zero that a box needs",
    ),
    (
        FALLING,
        {f"{TABLE}.shape": "box", f"{TABLE}.size": [1.0, 5e-324, 1.0]},
        "has 4.94066e-324 m where a box needs more; give",
    ),
    (FALLING, {f"{TABLE}.position": [0.0, 0.0, 0.1]}, "the cable begins 0.05 m inside it, at 0"),
    *(
        (FALLING, {METHOD: name}, r"terms.contact auto \(obstacle table\), since its steps cannot")
        for name in ("energy_momentum_4", "velocity_verlet")
    ),
    (THREADED, RING | {f"{GUIDE}.size": [0.006, 0.01, 0.0]}, "an opening of 0.006 m, through wh"),
    (THREADED, CHANNEL | {f"{GUIDE}.size": [0.01, 0.01, 0.005]}, "shorter than its wall is thick"),
    (THREADED, RING | {f"{GUIDE}.size": [0.01, 0.0, 0.0]}, "guide.size: .* zero that a ring needs"),
    (
        THREADED,
        RING | {f"{GUIDE}.position": [0.0, 0.0, 0.02], f"{GUIDE}.size": [0.02, 0.02, 0.0]},
        "guide.position: the cable begins",
    ),
    (MESHED, BOX | {f"{BODY}.mesh_scale": 1e-6}, "mesh_scale: a mesh of 1e-07 m is a crumb beside"),
    (MESHED, BOX | {f"{BODY}.mesh_cells": 7}, "mesh_cells: 7 are too few; give 8 or more, or 0"),
    (MESHED, SPHERE, "body.position: the cable begins 0.0.* m inside it"),
    (MESHED, {}, "obstacles.body.mesh: '' is no file"),
    (COILED, {"end.fixed": [True] * 3, "end.position": [0.001, 0.0, 0.0]}, "begins 0.004 m inside"),
    *(
        (COILED, APART | {METHOD: name}, f"{name} is not valid with contact.self_contact on")
        for name in ("velocity_verlet", "energy_momentum_4")
    ),
    (GRASPED, {"grasps.names": ["start"]}, "grasps.names: 'start' is not a name"),
    (GRASPED, {f"{HAND}.clamped": True, f"{HAND}.fixed": [True, True, False]}, f"{HAND}.clamped"),
    (GRASPED, {"grasps.foot.at": 0.2}, "grasps.foot.at: 0.2 belongs to a name that is not in"),
    (GRASPED, {f"{HAND}.at": 0.0}, f"^{HAND}.at: the cable is held at 0 m already"),
    (JAWED | MIDDLE, {f"{HAND}.clamped": False, f"{HAND}.jaw": 0.06}, f"^{HAND}.jaw: 0.06 m of"),
    (RODLIKE, {f"{HAND}.clamped": False}, f"{HAND}.roll: .*needs the direction held"),
    (RODLIKE, {f"{HAND}.roll_spring": 1e-3}, r"roll_spring: .*grasps\.hand\.roll: false"),
    (RODLIKE, {"end.roll_spring": 1.0}, "end.roll_spring: .*would do nothing beside a clamp"),
    (RODLIKE, {"end.tangent_spring": 1.0}, "end.tangent_spring: .*would do nothing beside a cl"),
    (SLIDING, {"grasps.guide.clamped": True}, "tangent_spring"),
    (SLIDING, {"grasps.guide.roll": True}, "roll"),
    (SLIDING, {"grasps.guide.fixed": [True, True, False]}, "fixed"),
    (SLIDING, VERLET, "energy_momentum"),
    (SLIDING, {"grasps.guide.slides": False, "grasps.guide.grip": 1.0}, "does nothing for a cable"),
    (
        NATURAL,
        {"cable.rest_curvature_axis": [1.0, 0.0, 0.0], "cable.rest_curvature": [4.0]},
        "acro",
    ),
    (
        NATURAL,
        {"terms.twist": "off", "cable.rest_twist": [1.0]},
        "cable.rest_twist: .* needs .* to",
    ),
    (
        SHAFT,
        VERLET | {"terms.twist": "quasistatic", "damping.stiffness": 0.0},
        "use energy_momentum",
    ),
    (HOSE, {"hose.bore": 0.0}, "hose.bore: .* below cable.diameter"),
    (HOSE, {"hose.bore": 0.02}, "hose.bore: .* below cable.diameter"),
    (HOSE, {"hose.bore": 0.014, "hose.pressure": 0.0}, "hose.bore: 0.014 m is too wide; give it"),
    (WET, VERLET, r"water\.density 1000; use energy_momentum"),
    (WET, {"water.density": 0.0, "water.level": 1.0}, "level: 1.0 m is the surface of no water"),
    (FALLING, {"water.velocity": [5.0, 0.0, 0.0]}, "velocity: .* give water.density, 1.2 for wind"),
    *(
        (SOFT, FREE_ENDS | DRAG | {METHOD: name}, r"damping\.air_drag_ratio 0\.5; use energy_mom")
        for name in ("velocity_verlet", "rk4", "zhai")
    ),
    (WIRE, {METHOD: "forest_ruth", "damping.mass": 1.0, STEP: 1e-4}, "damping.mass 1, .* sub-ste"),
    (WIRE, {METHOD: "forest_ruth", STEP: 1e-2}, "step: 0.01 s exceeds the stability limit"),
    (WIRE, {METHOD: "generalized_alpha", STEP: 1e-3}, "'generalized_alpha'.*; use energy_momentum"),
    (WIRE, {METHOD: "velocity_verlet", "damping.stiffness": 0.01, STEP: 1e-6}, "damping.stiffness"),
    (SOFT, {"terms.plasticity": "on"}, "needs plasticity.yield_curvature"),
    (SOFT, YIELD | {"terms.bend": "off"}, "terms.bend is off"),
    (SOFT, YIELD | {METHOD: "energy_momentum_4"}, "not valid with plasticity.yield"),
    (
        SOFT,
        SPANS | {"discretization.quadrature": "uniform", "discretization.samples": 101},
        "discretization.stretch: 'span'.*discretization.quadrature to gauss",
    ),
    (SOFT, SPANS | {"discretization.control_points": 4}, "'span'.*5 control points"),
    (
        SOFT,
        {"terms.twist": "bishop", "discretization.control_points": 4, "discretization.samples": 2},
        "discretization.samples: 2 points of a single span leave twist.*give 3, or 5 control",
    ),
]


@pytest.mark.parametrize(("scene", "changes", "words"), SCENES)
def test_a_scene_is_refused(scene, changes, words):
    with pytest.raises(SceneError, match=words) as refusal:
        simulator(scene, changes)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", METHODS)
def test_damping_that_a_method_does_not_admit_is_refused(name):
    method = METHODS[name]
    for values, admitted in (
        (MASS_DAMPED, method.mass_damping),
        (FULL | {"damping.stiffness": 2e-3}, method.stiffness_damping),
    ):
        if not admitted:
            with pytest.raises(SceneError, match=f"integrator.method: {name}"):
                simulator(values, n=6, method=name)


CALLS = [
    (lambda sim: sim.set_load("tap", [1, 0, 0]), "load: 'tap' is not known; give one of tip"),
    (lambda sim: sim.set_load("tip", [1, 0]), r"force of tip: .* got \[1, 0\]"),
    (lambda sim: sim.set_end("middle", [0, 0, 0]), "end: 'middle' is not known; give one of start"),
    (lambda sim: sim.reaction("middle"), "end: 'middle' is not known; give one of start, end"),
    (lambda sim: sim.set_end("start", orientation=[0.0] * 4), "orientation of start"),
    (lambda sim: sim.set_end("start", tangent=[0.0] * 3), "tangent of start"),
    (lambda sim: sim.set_end("start", tangent=[0, 0, 1], orientation=[0, 0, 0, 1]), "tangent"),
    (lambda sim: sim.set_end("start", [0, 0, 0.1], [0, 0, 0, np.nan]), "orientation of start"),
    (lambda sim: sim.advance_steps(2.5), "steps"),
    (lambda sim: sim.advance(-1.0), "duration"),
    (lambda sim: sim.restore(simulator(SOFT, n=7).snapshot()), "another scene"),
    (lambda sim: sim.start_from(np.zeros((6, 4))), "coincide"),
    (lambda sim: sim.centerline([1.1]), "outside"),
]


@pytest.mark.parametrize(("call", "words"), CALLS)
def test_a_call_is_refused_whole(call, words):
    """What it may have changed before it was refused is not changed."""
    sim = simulator(SOFT, {"terms.out_of_plane": "on"}, n=6)
    before = sim.cable.state.copy(), sim.cable.inputs.copy(), sim.end_pose("start")
    with pytest.raises(ValueError, match=words) as refusal:
        call(sim)
    assert "\n" not in str(refusal.value)
    assert np.array_equal(sim.cable.state, before[0])
    assert np.array_equal(sim.cable.inputs, before[1])
    assert np.array_equal(sim.end_pose("start")[0], before[2][0])
