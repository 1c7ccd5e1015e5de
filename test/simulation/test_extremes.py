"""Extreme scenes, ordinary for users of stiff, thin, long or short cables; a wrong one is seen.

The scenes are changed by nothing that matters, so that many share one compiled step: damping of
1e-30, an end that may be driven and is not, a third dimension in which nothing happens.
"""

from dataclasses import replace

import extreme_scenes
import pytest
from extreme_scenes import ALUMINIUM, RAN, REFUSED, STOPPED, Extreme, examine, wire

BY_NAME = {extreme.name: extreme for extreme in extreme_scenes.EXTREMES}
NOTHING = 1e-30  # of damping
GUIDED = (
    "aluminium wire",
    "steel wire",
    "aluminium wire, automatic",
    "n_u = 4",
    *(one.name for one in extreme_scenes.WIRES if one.name.startswith("step of")),
)
HELD = (
    "glass fibre",
    "rubber hose",
    "rubber hose, automatic",
    "overhead line",
    "slack cable snapped taut",
    "ends that meet",
    "pose jump of 1 m in one tick",
    "stiffness times 1e6 at run time",
    "catenary settled by damping",
    "catenary at rest, large damping",
    "cable of 1 mm",
    "cable of 1 km",
)
PUSHED = (
    "suture of 3 kg/m^3",
    "suture of 1300 kg/m^3",
    "suture of 1300 kg/m^3, automatic",
    "suture at rest",
    "pulse of 1e6 N for 1 ms",
    "free flight",
    "straight under compression",
    "column below its buckling load",
    "column above its buckling load",
)
ALONE = ("straight under twist", "ring", "n_u = 2000")


def sharing(name: str) -> Extreme:
    """The scene with terms that make no difference, as others have them."""
    extreme = BY_NAME[name]
    values = dict(extreme.values)
    if name in HELD:
        values |= {"start.pose_topic": "/start", "terms.gravity": "on"}
        for key in ("damping.mass", "damping.stiffness"):
            values.setdefault(key, NOTHING)
    if name in PUSHED:
        values["terms.out_of_plane"] = "on"
    return replace(extreme, values=values)


def test_every_scene_has_its_own_name():
    assert len(BY_NAME) == len(extreme_scenes.EXTREMES)
    known = {*GUIDED, *HELD, *PUSHED, *ALONE}
    sudden = {name for name in BY_NAME if name.endswith("sudden")}
    assert known | sudden == set(BY_NAME)


@pytest.mark.parametrize("name", [*GUIDED, *HELD, *PUSHED, *ALONE])
def test_extreme_scene(name):
    finding = examine(sharing(name))
    assert finding.outcome == RAN, finding.reason
    assert finding.right, finding


def test_steel_is_as_fast_as_aluminium():
    """Counted in iterations, which no other load of the machine changes."""
    steel, aluminium = (examine(sharing(f"{metal} wire")).run for metal in ("steel", "aluminium"))
    assert steel.cells[1:3] == aluminium.cells[1:3]  # method and step
    assert steel.steps == aluminium.steps
    assert steel.iterations <= 1.1 * aluminium.iterations


def test_automatic_scenes_name_neither_method_nor_step():
    automatic = [one for one in extreme_scenes.EXTREMES if one.name.endswith("automatic")]
    assert len(automatic) == 3
    for extreme in automatic:
        assert extreme.values["integrator.method"] == "auto"
        assert extreme.values["integrator.step"] == 0.0


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("overhead line", {"gravity": [1.0, 0.0, -9.81]}),
        ("glass fibre", {"end.mass": 1e-7}),
        ("column above its buckling load", {"loads.side.force": [0.0, 0.0, 0.02]}),
        ("suture at rest", {"end.position": [0.101, 0.0, 0.0]}),
        ("straight under compression", {"loads.side.force": [0.0, 0.0, 1e-6]}),
    ],
)
def test_a_wrong_cable_is_not_right(name, changes):
    extreme = sharing(name)
    finding = examine(replace(extreme, values=extreme.values | changes))
    assert finding.outcome == RAN
    assert finding.error > extreme.bound
    assert not finding.right


def test_refused_and_slow_scenes_are_not_right(monkeypatch):
    refused = examine(Extreme("no", "", {"cable.length": -1.0}, 1.0, lambda run: 0.0, 1.0))
    assert (refused.outcome, refused.right) == (REFUSED, False)
    assert "cable.length" in refused.reason
    monkeypatch.setattr(extreme_scenes, "BUDGET", 0.0)
    slow = examine(BY_NAME["aluminium wire"])
    assert (slow.outcome, slow.right) == (STOPPED, False)
    assert "budget" in slow.reason


def test_a_stopped_scene_keeps_its_state():
    """A step far beyond the limit of an explicit method, taken all the same."""
    values = wire(ALUMINIUM) | {"integrator.method": "velocity_verlet"}
    with pytest.MonkeyPatch.context() as patch:
        simulator = extreme_scenes.Simulator
        patch.setattr(
            extreme_scenes, "Simulator", lambda scene: simulator(scene, unchecked_step=True)
        )
        finding = examine(replace(BY_NAME["aluminium wire"], values=values))
    assert (finding.outcome, finding.right) == (STOPPED, False)
    assert "energy" in finding.reason
