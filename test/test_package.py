"""The package as pip, colcon and ROS see it."""

import configparser
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

import dlo_sim
from dlo_sim.scene.loading import shipped_scenes


def test_every_room_is_a_package(checkout):
    folders = {path.parent for path in (checkout / "dlo_sim").rglob("*.py")}
    assert folders
    assert [folder for folder in folders if not (folder / "__init__.py").is_file()] == []


@pytest.fixture(scope="module")
def manifest(checkout) -> ElementTree.Element:
    return ElementTree.parse(checkout / "package.xml").getroot()


def test_manifest_has_the_fields_of_format_3(manifest):
    assert manifest.tag == "package"
    assert manifest.attrib == {"format": "3"}
    tags = [child.tag for child in manifest]
    for once in ("name", "version", "description", "export"):
        assert tags.count(once) == 1
    assert {"maintainer", "license"} <= set(tags)
    email = manifest.find("maintainer").get("email")
    assert re.fullmatch(r"[-\w%+]+(\.[-\w%+]+)*@[-\w%]+(\.[-\w%]+)*\.[a-zA-Z]{2,}", email)
    assert manifest.findtext("export/build_type") == "ament_python"
    depends = {child.text for child in manifest if child.tag.endswith("depend")}
    assert not {key for key in depends if key.endswith("-pip")}, "it could not be released"
    assert len({(c.tag, c.text) for c in manifest}) == len(tags), "nothing is there twice"


def test_name_version_and_licence_agree(checkout, manifest):
    name, version, email = (
        subprocess.run(
            [sys.executable, "setup.py", "--quiet", "--name", "--version", "--maintainer-email"],
            cwd=checkout,
            capture_output=True,
            text=True,
            check=True,
        )
        .stdout.strip()
        .splitlines()[-3:]
    )
    assert re.fullmatch(r"(0|[1-9]\d*)(\.(0|[1-9]\d*)){2}", version)
    assert (manifest.findtext("name"), manifest.findtext("version")) == (name, version)
    assert dlo_sim.__version__ == version
    assert manifest.find("maintainer").get("email") == email
    assert manifest.findtext("license") == "Apache-2.0"
    assert (checkout / manifest.find("license").get("file")).read_text().split()[:2] == [
        "Apache",
        "License",
    ]


HEADING = r"## v(\d+\.\d+\.\d+) - (not released yet|\d{4}-\d{2}-\d{2})"


def test_changelog_begins_with_this_version(checkout):
    text = (checkout / "CHANGELOG.md").read_text(encoding="utf-8")
    headings = [line for line in text.splitlines() if line.startswith("## ")]
    found = [re.fullmatch(HEADING, line) for line in headings]
    assert all(found), "tag and date of each version"
    versions = [tuple(map(int, one[1].split("."))) for one in found]
    assert found[0][1] == dlo_sim.__version__
    assert versions == sorted(set(versions), reverse=True)
    assert [one[2] for one in found[1:]].count("not released yet") == 0


def test_the_commands_of_a_release_set_the_version_everywhere(checkout, tmp_path):
    """Those before the checks are run in a copy of the files that they change."""
    text = (checkout / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (commands,) = re.findall(r"## Release\n.*?```\n(.*?)```", text, re.DOTALL)
    edits = commands[: commands.index(".ci/run")]
    (tmp_path / "dlo_sim").mkdir()
    names = ["dlo_sim/__init__.py", "package.xml", "CHANGELOG.md"]
    before = {name: (checkout / name).read_text(encoding="utf-8") for name in names}
    for name, content in before.items():
        (tmp_path / name).write_text(content, encoding="utf-8")
    edits = re.sub(r"^version=.*$", "version=7.8.9", edits, flags=re.MULTILINE)
    subprocess.run(["bash", "-euc", edits], cwd=tmp_path, check=True, timeout=60)
    after = {name: (tmp_path / name).read_text(encoding="utf-8") for name in names}
    new = [
        [line for line in after[name].splitlines() if line not in before[name].splitlines()]
        for name in names
    ]
    assert new[0] == ['__version__ = "7.8.9"']
    assert new[1] == ["  <version>7.8.9</version>"]
    assert len(new[2]) == 1 and re.fullmatch(HEADING, new[2][0])[1] == "7.8.9"


def test_ros_finds_executables_scenes_and_index(installed):
    assert {path.name for path in (installed / "lib/dlo_sim").iterdir()} == {"dlo_sim", "node"}
    assert (installed / "share/ament_index/resource_index/packages/dlo_sim").is_file()
    assert (installed / "share/dlo_sim/package.xml").is_file()
    scenes = {path.stem for path in (installed / "share/dlo_sim/config").glob("*.yaml")}
    assert scenes == set(shipped_scenes())
    views = {"cable.launch.py", "cable.rviz", "cable.foxglove.json"}
    assert views <= {path.name for path in (installed / "share/dlo_sim/config").iterdir()}


def test_installed_package_finds_its_scenes_and_no_other(installed, tmp_path):
    library = next(installed.glob("l*/**/dlo_sim/__init__.py")).parents[1]
    code = (
        "import dlo_sim, dlo_sim.scene.loading as s;"
        "print(dlo_sim.__file__); print(s.shipped_scene('paper_wire'));"
        "print(dlo_sim.load_scene('paper_wire').cable.length)"
    )
    assert (library / "dlo_sim" / "py.typed").is_file(), "type checkers use its annotations"
    lines = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={"PYTHONPATH": str(library)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    assert lines[0].startswith(str(library))
    assert lines[1:] == [str(installed / "share/dlo_sim/config/paper_wire.yaml"), "2.0"]


def test_entry_points_exist(installed):
    entry_points = next(installed.glob("l*/**/dlo_sim-*.egg-info/entry_points.txt"))
    parser = configparser.ConfigParser()
    parser.read(entry_points)
    scripts = dict(parser["console_scripts"])
    assert scripts == {"dlo_sim": "dlo_sim.__main__:main", "node": "dlo_sim.__main__:node"}
    from importlib import import_module

    for target in scripts.values():
        module, function = target.split(":")
        assert callable(getattr(import_module(module), function))
