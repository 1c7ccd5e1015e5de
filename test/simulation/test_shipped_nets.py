"""The shipped nets along the plans that their files describe."""

import numpy as np
import pytest

from dlo_sim.replay.planned import read_plan
from dlo_sim.scene.loading import load_scene, shipped_scene
from dlo_sim.simulation.simulator import Simulator


def along(name, tmp_path, change=lambda line: line, **values):
    """A simulator at rest at the start of the plan in the comments of a scene, and its forecast."""
    lines = shipped_scene(name).read_text().splitlines()
    first = lines.index("# with this plan.yaml:") + 2
    plan = [line[4:] for line in lines[first : lines.index("/**:")]]
    (tmp_path / "plan.yaml").write_text("\n".join(map(change, plan)))
    scene = load_scene(name, {"accuracy.estimate": "off", **values})
    sim = Simulator(scene)
    return sim, sim.forecast(read_plan(tmp_path / "plan.yaml", scene))


def test_harness_rests_and_is_moved_by_two_grippers(tmp_path):
    sim, found = along("harness", tmp_path)
    report = sim.advance(0.5)
    assert report.status.ok and sim.energy().kinetic < 1e-20
    clip = sim.centerline([0.2], "motor")[0]
    assert clip == pytest.approx((0.6, 0.19, 0.45), abs=1e-9)
    roots = {"lamp": 0.3, "motor": 0.65}
    for name, u in roots.items():
        root = sim.centerline([0.0], name)
        assert root == pytest.approx(sim.centerline([u]), abs=1e-9)
    position, turned = sim.connector_pose("plug")
    assert position[2] < 0.15 and np.linalg.norm(turned) == pytest.approx(1.0)
    assert found.report.status.ok and len(found.times) == 100
    assert found.centerline[-1, 0] == pytest.approx((0.1, 0.06, 0.65))
    assert found.centerline[-1, -1] == pytest.approx((0.7, 0.3, 0.62))
    middle = np.interp(
        0.2, found.net["motor.centerline_u"], found.net["motor.centerline"][-1, :, 2]
    )
    assert middle == pytest.approx(0.45, abs=1e-3)


@pytest.mark.parametrize(("turned", "pushed"), [(True, 0.54), (False, 0.5)])
def test_plug_fits_its_opening_only_if_it_is_turned(tmp_path, turned, pushed):
    """Else it stands at the blocks, whose faces are at 0.545 m, 4.5 cm ahead of the cable."""

    def change(line):
        values = line.split(",")
        turn = [" 0.0"] * 3 + [" 1.0]"]
        return line if turned or len(values) < 7 or ":" in line else ",".join(values[:3] + turn)

    _, found = along("plug", tmp_path, change)
    assert found.report.status.ok
    assert found.centerline[-1, -1, 0] == pytest.approx(pushed, abs=1e-3)
    force = found.contact["total"]
    # The spring of 2000 N/m, 4 cm short; each block pushes back half of it.
    assert force == (0.0 if turned else pytest.approx(2000.0 * 0.04, rel=0.1))
