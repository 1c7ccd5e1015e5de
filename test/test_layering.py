"""The rooms and the arrows between them: who may import whom, and what importing costs."""

import ast
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1] / "dlo_sim"

# Room -> the rooms that it may import. Arrows point downwards only.
ARROWS = {
    "process": set(),
    "core": set(),
    "scene": set(),
    "compiling": set(),
    "terms": {"compiling"},
    "engine": {"compiling", "terms"},
    "methods": {"compiling", "engine", "terms"},
    "simulation": {"compiling", "core", "engine", "methods", "process", "scene", "terms"},
    "batch": {"core", "process", "scene", "simulation"},
    "tuning": {"batch", "core", "scene", "simulation"},
    "session": {"core", "process", "scene", "simulation"},
    "replay": {"core", "process", "scene", "session", "simulation"},
    "identification": {"batch", "core", "replay", "scene", "session", "simulation"},
    "ros": {"compiling", "core", "process", "scene", "session", "simulation"},
    "studies": {
        *("batch", "core", "identification", "process", "scene", "session", "simulation"),
        "tuning",
    },
    "view": {"core", "replay", "scene", "session", "simulation"},
    "doctor": {"compiling", "process", "ros", "scene", "session", "simulation"},
    "demo": {"core", "process", "replay", "scene", "session", "view"},
    "cli": {
        *("batch", "compiling", "core", "demo", "doctor", "identification", "process", "replay"),
        *("ros", "scene", "session", "simulation", "studies", "tuning", "view"),
    },
    # dlo_sim/__init__.py and dlo_sim/__main__.py
    "": {"cli", "core", "process", "ros", "scene", "simulation"},
}
ROS_MESSAGES = {f"{kind}_msgs" for kind in "diagnostic geometry lifecycle rosgraph sensor".split()}
ROS_MESSAGES |= {"std_msgs", "std_srvs", "trajectory_msgs", "visualization_msgs"}
ROS_MESSAGES |= {"builtin_interfaces", "rcl_interfaces"}
# Foreign package -> the rooms, or files, that may import it.
FOREIGN = {
    "rclpy": {"ros"},
    **dict.fromkeys(ROS_MESSAGES, {"ros"}),
    "tf2_ros": {"ros/transforms.py"},
    "rosbags": {"replay/bags.py", "session/cdr.py"},
    "mcap": {"replay/storage.py"},
    "matplotlib": {"studies", "demo", "view/film.py"},
    "mpl_toolkits": {"view/film.py"},
    "ruamel": {"scene", "cli", "ros"},
    "numba": {
        "compiling",
        "engine",
        "methods",
        "simulation/buckling.py",
        "simulation/self_contact.py",
        "simulation/soundness.py",
    },
    "distributed": {"batch/workers.py"},
    "scipy": {"identification/fit.py"},
    "tqdm": {"cli"},
    "trimesh": {"simulation/meshes.py"},
}


def modules() -> dict[str, Path]:
    """Every module of the package by its dotted name."""
    names = {}
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT.parent).with_suffix("").parts
        names[".".join(part for part in parts if part != "__init__")] = path
    return names


MODULES = modules()


def room(module: str) -> str:
    """The room of a module; empty for the package itself."""
    parts = module.split(".")
    is_room = len(parts) > 2 or (ROOT / parts[-1]).is_dir()
    return parts[1] if len(parts) > 1 and is_room else ""


@cache
def imported(module: str) -> set[str]:
    """Dotted names that a module imports, wherever in the file."""
    path = MODULES[module]
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package.split(".")
            base = base[: len(base) - node.level + 1] if node.level else []
            source = ".".join([*base, *filter(None, [node.module])])
            names |= {source} | {
                f"{source}.{alias.name}"
                for alias in node.names
                if f"{source}.{alias.name}" in MODULES
            }
    return names


def test_every_room_has_its_arrows():
    assert {room(module) for module in MODULES} <= set(ARROWS)


def test_arrows_have_no_cycle():
    tuple(TopologicalSorter(ARROWS).static_order())


@pytest.mark.parametrize("module", MODULES)
def test_module_imports_only_rooms_below(module):
    mine = room(module)
    used = {room(name) for name in imported(module) if name.startswith("dlo_sim.")}
    assert used - {mine, ""} <= ARROWS[mine]


def test_no_modules_import_each_other_in_a_circle():
    # A module may import from the package that it is in.
    graph = {
        name: {to for to in imported(name) & set(MODULES) if not name.startswith(to)}
        for name in MODULES
    }
    tuple(TopologicalSorter(graph).static_order())


@pytest.mark.parametrize("module", MODULES)
def test_module_imports_only_its_foreign_packages(module):
    where = {room(module), MODULES[module].relative_to(ROOT).as_posix()}
    for name in {name.split(".")[0] for name in imported(module)} & set(FOREIGN):
        assert where & FOREIGN[name], f"{module} must not import {name}"


def loaded_after(statements: str) -> set[str]:
    """Top-level modules in a fresh interpreter after these statements."""
    code = f"import sys\n{statements}\nprint(*sorted({{m.split('.')[0] for m in sys.modules}}))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT.parent
    )
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


HEAVY = {"numba", "rclpy", "rosbags", "matplotlib"}


@pytest.mark.parametrize(
    ("statements", "light"),
    [
        ("import dlo_sim; dlo_sim.__version__; dir(dlo_sim)", HEAVY | {"numpy", "ruamel"}),
        ("import dlo_sim; dlo_sim.load_scene('paper_wire')", HEAVY),
        (
            "from dlo_sim.cli.main import main\ntry: main(['--help'])\nexcept SystemExit: pass",
            HEAVY | {"numpy"},
        ),
    ],
)
def test_what_needs_neither_ros_nor_a_compiler_loads_none(statements, light):
    loaded = loaded_after(statements)
    assert "dlo_sim" in loaded
    assert not loaded & light


def test_nothing_outside_its_room_loads_ros():
    names = [name for name in MODULES if room(name) != "ros" and name != "dlo_sim.__main__"]
    assert len(names) > 10
    everything = "\n".join(f"import {name}" for name in names)
    assert not loaded_after(everything) & {"rclpy", *ROS_MESSAGES}


def test_only_rooms_with_messages_load_rosbags():
    above = {"session", "replay", "identification", "ros", "studies", "view", "doctor", "demo"}
    names = [name for name in MODULES if room(name) not in above and name != "dlo_sim.__main__"]
    assert not loaded_after("\n".join(f"import {name}" for name in names)) & {"rosbags"}


def test_unknown_name_of_the_package_is_refused():
    import dlo_sim

    with pytest.raises(AttributeError, match="no attribute 'load_scenes'"):
        _ = dlo_sim.load_scenes
