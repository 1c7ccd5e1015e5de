"""Triangle meshes as obstacles."""

import math
import os
import sys
import zipfile

import numpy as np
import pytest
import solids
import trimesh
from cables import simulator

from dlo_sim.core import rotations
from dlo_sim.scene.description import Obstacle
from dlo_sim.scene.loading import SceneError, load_scene
from dlo_sim.session import cdr
from dlo_sim.session.outputs import Outputs
from dlo_sim.simulation import meshes
from dlo_sim.studies import bodies

RADIUS = 0.005
LYING = {
    "cable.length": 0.2,
    "cable.diameter": 2.0 * RADIUS,
    "cable.density": 1200.0,
    "cable.youngs_modulus": 1e7,
    "integrator.tolerance": 1e-12,
    "damping.mass": 5.0,
    "damping.stiffness": 0.01,
    "start.fixed": [False] * 3,
    "start.position": [-0.1, 0.0, RADIUS],
    "end.position": [0.1, 0.0, RADIUS],
    "obstacles.names": ["body"],
    "obstacles.body.shape": "mesh",
    "contact.stiffness": 1e5,
    "discretization.control_points": 9,
}


def lying(triangles, *values, cells=48):
    mesh = {"obstacles.body.mesh": meshes.keep_triangles(triangles)}
    mesh["obstacles.body.mesh_cells"] = cells
    return simulator(LYING, mesh, *values, method="energy_momentum", step=5e-3)


def test_a_cable_rests_on_a_meshed_box_as_on_a_box():
    """And overhangs its rounded edges."""
    place = {"obstacles.body.position": [0.0, 0.0, -0.03]}
    exact = {"obstacles.body.shape": "box", "obstacles.body.size": [0.14, 0.1, 0.06]}
    found = []
    for sim in (
        lying(solids.box(0.14, 0.1, 0.06), place),
        lying(solids.sphere(1.0, 3), place, exact),
    ):
        sim.advance(2.0)
        assert sim.energy().kinetic < 1e-9
        weight = sim.scene.cable.mu * 0.2 * 9.81
        np.testing.assert_allclose(
            sim.contact("body").force, [0.0, 0.0, weight], atol=1e-3 * weight
        )
        found.append(sim.centerline(np.linspace(0.05, 0.15, 21))[:, 2])
        assert sim.energy_error < 1e-9
    np.testing.assert_allclose(found[0], found[1], atol=0.002 * RADIUS)


def test_a_meshed_drum_is_a_capstan():
    """On average: where samples stick and slip depends on rounding, which moves the pull by 1 %."""
    errors = []
    for off in range(5):
        scale = 1e3 * (1.0 + 1e-10 * off)
        mesh = meshes.keep_triangles(scale * solids.cylinder(0.1, 0.06, 128))
        drum = {
            "obstacles.drum.shape": "mesh",
            "obstacles.drum.mesh": mesh,
            "obstacles.drum.mesh_scale": 1e-3,
            "terms.out_of_plane": "auto",
            "terms.twist": "off",
        }
        (answer,) = bodies.capstan(0.5 * math.pi, 43, drum).answers
        errors.append(answer.error)
    assert abs(np.mean(errors)) < 0.01
    assert np.abs(errors).max() < 0.03


def test_the_field_is_the_distance_from_the_solid():
    """Inside and outside, and no more than it beyond the grid."""
    triangles = solids.sphere(0.1, 40)
    sim = lying(triangles, {"obstacles.body.position": [0.0, 0.0, -0.2]})
    field = meshes.field_of(sim.scene.obstacles[0], RADIUS)
    points = np.random.default_rng(3).uniform(-0.12, 0.12, (500, 3))
    exact = np.linalg.norm(points, axis=1) - 0.1
    found = field.distance(points)
    near = np.abs(exact) < 0.02
    np.testing.assert_allclose(found[near], exact[near], atol=1e-3)
    assert (np.sign(found) == np.sign(exact))[np.abs(exact) > 1e-3].all()
    away = field.distance(3.0 * points) - (np.linalg.norm(3.0 * points, axis=1) - 0.1)
    assert away.max() < 1e-3


def body_of(tmp_path, file, **values):
    (tmp_path / "scene.yaml").write_text(
        "/**:\n  ros__parameters:\n    obstacles:\n      names: [body]\n      body:\n"
        f"        shape: mesh\n        mesh: '{file}'\n        position: [0.0, 0.0, -1.0]\n"
    )
    return load_scene(tmp_path / "scene.yaml", values).obstacles[0]


@pytest.mark.parametrize("kind", ["stl", "ascii.stl", "obj", "ply", "GLB", "dae"])
def test_a_file_beside_the_scene_is_read(tmp_path, kind):
    box = solids.box(0.3, 0.2, 0.1) + [0.0, 0.0, 0.3]
    if kind == "ascii.stl":
        content = solids.ascii_stl(box)
    else:
        content = solids.files(box, kind.lower())
    (tmp_path / f"body.{kind}").write_bytes(content)
    triangles = meshes.field_of(body_of(tmp_path, f"body.{kind}"), 0.0).triangles
    assert triangles.shape == box.shape
    np.testing.assert_allclose(
        np.sort(triangles, axis=None), np.sort(box, axis=None), rtol=1e-7, atol=1e-9
    )


def test_bodies_stand_where_the_scene_of_their_file_places_them(tmp_path):
    """Two boxes of one geometry: one moved, one turned by a quarter and twice as large."""
    moved, turned = np.eye(4), np.diag([2.0, 2.0, 2.0, 1.0])
    moved[0, 3] = 0.3
    turned[:2, :2] = [[0.0, -2.0], [2.0, 0.0]]
    (tmp_path / "two.glb").write_bytes(
        solids.files(solids.box(0.3, 0.2, 0.1), "glb", moved, turned)
    )
    corners = meshes.triangles_of(body_of(tmp_path, "two.glb")).reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    np.testing.assert_allclose(low, [-0.2, -0.3, -0.1], rtol=1e-6)
    np.testing.assert_allclose(high, [0.45, 0.3, 0.1], rtol=1e-6)


def test_a_unit_that_a_file_names_is_kept(tmp_path):
    content = solids.files(solids.box(300.0, 200.0, 100.0), "dae")
    unit = b'<unit name="millimeter" meter="0.001"/><up_axis>'
    (tmp_path / "mm.dae").write_bytes(content.replace(b"<up_axis>", unit))
    found = meshes.triangles_of(body_of(tmp_path, "mm.dae"))
    np.testing.assert_allclose(np.ptp(found.reshape(-1, 3), axis=0), [0.3, 0.2, 0.1], rtol=1e-6)


@pytest.mark.parametrize("turned", [0, 1])
def test_bodies_that_overlap_are_one(turned):
    """And one whose triangles are not oriented alike is a body."""
    box = solids.box(0.1, 0.1, 0.1)
    box[: 16 * turned : 3] = box[: 16 * turned : 3, ::-1]
    other = solids.box(0.1, 0.1, 0.1) + [0.05 + 0.1 * turned, 0.0, 0.0]
    name = meshes.keep_triangles(np.concatenate([box, other]))
    body = Obstacle("body", shape="mesh", mesh=name, mesh_cells=30)
    points = np.array([[-0.03, 0, 0], [0.02, 0.01, 0], [0.08 + 0.1 * turned, 0, 0], [0, 0.08, 0]])
    found = meshes.field_of(body, RADIUS).distance(points + 1e-4)
    assert (np.sign(found) == [-1, -1, -1, 1]).all()


def test_a_mesh_of_a_package_is_found(tmp_path, monkeypatch):
    folder = tmp_path / "share" / "robot" / "meshes"
    folder.mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/none:{tmp_path}")
    assert meshes.found_path("package://robot/meshes/a.stl") == folder / "a.stl"
    with pytest.raises(ValueError, match="not installed, or its workspace is not sourced"):
        meshes.found_path("package://other/a.stl")


OPEN = solids.box(0.1, 0.1, 0.1)[1:]
BAD = np.where(np.arange(16)[:, None, None] == 3, np.nan, solids.box(0.1, 0.1, 0.1))
BINARY = solids.binary_stl(OPEN)
GLB = solids.files(OPEN, "glb")


@pytest.mark.parametrize(
    ("file", "content", "problem"),
    [
        ("a.stl", None, "cannot be read .No such file.*; check the path, which is relative to"),
        ("a.stl", b"", "has no triangles"),
        ("a.stl", BINARY[:-7], "is no STL file, or a damaged one .*; export it again"),
        ("a.stl", bytes(84), "has no triangles"),
        ("a.stl", BINARY, "is not closed: 3 of 24 edges .*; close its holes"),
        ("a.glb", GLB, "is not closed: 3 of 24 edges .*; close its holes"),
        ("a.stl", solids.binary_stl(BAD), "has a corner that is not finite"),
        ("a.ply", solids.files(BAD, "ply"), "has a corner that is not finite"),
        ("a.stl", solids.ascii_stl(BAD), "has a corner that is not finite"),
        ("a.stl", solids.binary_stl(0.0 * OPEN), "has no extent"),
        ("a.stl", solids.binary_stl(solids.box(0.1, 0.1, 0.1) * [1, 1, 0]), "is flat; a sheet"),
        ("a.stl", b"solid a\nvertex 1 2 x", "has no triangles"),
        ("a.obj", b"v 0 0 0\nf 1 2 9\n", "is no OBJ file, or a damaged one"),
        ("a.glb", GLB[:-7], "is no GLB file, or a damaged one"),
        ("a.ply", b"", "is no PLY file, or a damaged one"),
        ("a.dae", b"<a/>", "is no DAE file, or a damaged one"),
        ("a.step", b"ISO-10303-21", "'.step' cannot be read here; convert it to STL, OBJ, PLY"),
        ("a", b"", "a file '.' cannot be read here; convert it to STL"),
    ],
)
def test_a_mesh_that_is_no_solid_is_refused(tmp_path, file, content, problem):
    path = tmp_path / file
    if content is not None:
        path.write_bytes(content)
    obstacle = Obstacle("body", shape="mesh", mesh=str(path))
    with pytest.raises(SceneError, match=f"obstacles.body.mesh: .*{file}:? .*{problem}") as error:
        meshes.triangles_of(obstacle)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("file", "missing", "cure"),
    [
        ("a.stl", "trimesh", "install dlo_sim with the extra 'mesh'"),
        ("a.dae", "collada", "convert it to STL, .*, or pip install pycollada"),
    ],
)
def test_a_missing_library_is_named(tmp_path, monkeypatch, file, missing, cure):
    monkeypatch.setitem(sys.modules, missing, None)
    if missing == "collada":
        kinds = trimesh.available_formats() - {"dae"}
        monkeypatch.setattr(trimesh, "available_formats", lambda: kinds)
    (tmp_path / file).write_bytes(b"")
    body = Obstacle("body", shape="mesh", mesh=str(tmp_path / file))
    with pytest.raises(SceneError, match=f"obstacles.body.mesh: .*{cure}"):
        meshes.triangles_of(body)


def test_a_mesh_with_walls_that_its_cells_lose_is_told():
    place = {"obstacles.body.position": [0.0, 0.0, -0.003]}
    assert not lying(solids.box(0.4, 0.4, 0.006), place, cells=40).warnings
    (line,) = lying(solids.box(0.4, 0.4, 0.006), place, cells=15).warnings
    assert "mesh_cells: 15 are too few for its thinnest walls" in line
    assert "raise it" in line


THROUGH = {
    "cable.length": 0.4,
    "cable.diameter": 0.004,
    "cable.density": 1150.0,
    "cable.youngs_modulus": 5e6,
    "start.fixed": [True] * 3,
    "start.position": [-0.2, 0.0, 0.0],
    "end.fixed": [True] * 3,
    "end.position": [0.2, 0.0, 0.0],
    "loads.names": ["hand"],
    "loads.hand.type": "force",
    "loads.hand.position": 0.5,
    "loads.hand.signal": "constant",
    "loads.hand.force": [0.0, 0.0, 0.2],
    "gravity": [0.0] * 3,
    "contact.stiffness": 0.0,
    "discretization.control_points": 23,
}


@pytest.mark.parametrize("side", [0.1, 0.3])
def test_an_opening_is_as_wide_in_a_large_plate_as_in_a_small_one(side):
    """A hole of 8 mm, into whose edge a force pulls a cable of 4 mm: its middle is 2 mm up."""
    sim = lying(solids.plate(side, 0.008, 0.005), THROUGH, cells=0)
    assert sim.advance(1.0).status.ok
    assert not [line for line in sim.warnings if line.startswith("obstacles")]
    assert sim.centerline([0.2])[0, 2] == pytest.approx(2e-3, abs=2e-4)


def test_cells_too_coarse_for_an_opening_are_said():
    """Also where so many are not chosen, as in a plate of 2 m."""
    for side, cells, counts in ((0.3, 48, (48, 150)), (2.0, 0, (268, 1000))):
        (line,) = lying(solids.plate(side, 0.008, 0.005), THROUGH, cells=cells).warnings
        assert f"mesh_cells: {counts[0]} are too few for its thinnest walls and narrowest" in line
        assert f"raise it to {counts[1]}, or split the mesh" in line


def test_a_fall_on_a_mesh_of_few_cells_keeps_the_energy_account():
    """Its field is steeper than 1 above a wall that is thinner than two cells."""
    values = {"obstacles.body.position": [0.0, 0.0, -0.04], "damping.mass": 0.0}
    sim = lying(solids.box(0.8, 0.8, 0.02), values, cells=48)
    assert sim.advance(0.3).status.ok
    assert sim.contact("body").force[2] > 0.0
    assert sim.energy_error < 1e-5


def test_meshes_without_a_file_are_refused():
    with pytest.raises(SceneError, match="obstacles.body.mesh: '' is no file"):
        simulator(LYING)
    with pytest.raises(ValueError, match=r"triangles: need shape \(k, 3, 3\), got \(2, 3\)"):
        meshes.keep_triangles(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="triangles: is not closed"):
        meshes.keep_triangles(OPEN)
    box = solids.box(0.1, 0.1, 0.1)
    with pytest.raises(ValueError, match="triangles: has every triangle twice, as where both"):
        meshes.keep_triangles(np.concatenate([box, box[:, ::-1]]))


def test_a_cable_that_begins_in_a_mesh_is_refused():
    with pytest.raises(SceneError, match="body.position: the cable begins 0.0.* m inside it"):
        lying(solids.sphere(0.1, 12))
    turned = rotations.from_rotation_vector(np.array([0.0, 0.0, 1.0])).tolist()
    lying(
        solids.box(0.1, 0.1, 0.1),
        {"obstacles.body.position": [0.0, 0.0, -0.05], "obstacles.body.orientation": turned},
    )


def test_the_marker_of_a_mesh_names_its_file(tmp_path):
    """A reader of the bag finds the same triangles there."""
    path = tmp_path / "a body.stl"
    path.write_bytes(solids.binary_stl(solids.box(0.3, 0.1, 0.1)))
    mesh = {"obstacles.body.mesh": str(path), "obstacles.body.position": [0.0, 0.0, -0.06]}
    sim = simulator(LYING, mesh, method="energy_momentum", step=5e-3)
    (message,) = Outputs(sim.scene, 9).messages(sim, 0, ["~/contacts"])
    body = cdr.read(cdr.MARKER_ARRAY, message.data).markers[1]
    assert (body.type, body.pose.position.z) == (cdr.MESH_RESOURCE, -0.06)
    assert meshes.found_path(body.mesh_resource) == path


def test_what_may_never_end_or_is_no_plain_file_is_refused_unread(tmp_path):
    """A pipe that nobody writes to, a device, an archive whatever its name, gigabytes."""
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "zero.stl").symlink_to("/dev/zero")
    with zipfile.ZipFile(tmp_path / "body.zip", "w") as archive:
        archive.writestr("body.dae", solids.files(solids.box(0.3, 0.2, 0.1), "dae"))
    zipped = (tmp_path / "body.zip").read_bytes()
    (tmp_path / "zipped.dae").write_bytes(zipped)
    (tmp_path / "appended.dae").write_bytes(b"<COLLADA/>" + zipped)
    for kind in ("off", "3mf", "zae"):
        (tmp_path / f"body.{kind}").write_bytes(zipped)
    head = solids.files(solids.box(0.3, 0.2, 0.1), "glb")
    (tmp_path / "hollow.glb").write_bytes(head.replace(b'"bufferView"', b'"bufferNone"'))
    with (tmp_path / "long.stl").open("wb") as file:
        file.truncate(meshes.MOST_BYTES + 1)
    problems = {
        "pipe.stl": "is no regular file, and may never end",
        "zero.stl": "is no regular file, and may never end",
        "zipped.dae": "is an archive; unpack it",
        "appended.dae": "is an archive; unpack it",
        "hollow.glb": "does not hold all its data; export it without compression",
        "body.zip": "a file '.zip' cannot be read here; convert it to STL",
        "body.off": "a file '.off' cannot be read here",
        "body.3mf": "a file '.3mf' cannot be read here",
        "body.zae": "a file '.zae' cannot be read here",
        "long.stl": "has 500000001 bytes; reduce it to 500000000 or fewer",
    }
    for file, problem in problems.items():
        with pytest.raises(SceneError, match=f"obstacles.body.mesh: .*{file}: {problem}"):
            meshes.triangles_of(body_of(tmp_path, file))


@pytest.mark.parametrize(
    ("mesh", "problem"),
    [
        ("~nobody-of-this-name/a.stl", "nobody-of-this-name/a.stl cannot be read"),
        ("base64:", "base64:: has no triangles"),
        ("base64:xx", "base64:xx: Incorrect padding"),
        ("base64:AAAAAAAAAAA=", "are no triangles"),
        ("base64:" + "A" * 96, "has no extent"),
    ],
)
def test_names_that_stand_for_no_mesh_are_refused(tmp_path, mesh, problem):
    assert isinstance(body_of(tmp_path, mesh).mesh, str)
    with pytest.raises(SceneError, match=f"obstacles.body.mesh: .*{problem}") as error:
        simulator(LYING, {"obstacles.body.mesh": mesh})
    assert "\n" not in str(error.value)


def test_a_small_mesh_has_a_small_grid():
    """No finer than the cable can feel: a sphere thinner than the cable, whose field it
    touches as a sphere.
    """
    triangles = solids.sphere(0.003, 20)
    assert np.prod(meshes.Grid(triangles, 48, RADIUS).shape) < 50_000
    body = Obstacle("body", shape="mesh", mesh=meshes.keep_triangles(triangles))
    points = RADIUS * np.random.default_rng(1).standard_normal((200, 3))
    exact = np.linalg.norm(points, axis=1) - 0.003
    away = meshes.field_of(body, RADIUS).distance(points) - exact
    assert np.abs(away[(exact > 0.0) & (exact < RADIUS)]).max() < 0.05 * RADIUS
    with pytest.raises(ValueError, match="mesh_cells: 5000 cells along a mesh .* are too many"):
        meshes.Grid(solids.box(0.1, 0.1, 0.1), 5000, 0.0)
