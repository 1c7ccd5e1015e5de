"""What README.md and the reference in config/ say is what the code does."""

import re
import shlex

import pytest
import readme_blocks

from dlo_sim.cli.main import SUBCOMMANDS, _parser
from dlo_sim.scene.description import scene_parameters
from dlo_sim.scene.loading import load_scene, scene_from_values, shipped_scenes
from dlo_sim.session.topics import input_topics, output_topics, plan_topics


@pytest.fixture(scope="module")
def readme(checkout) -> str:
    return (checkout / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def node_page(checkout) -> str:
    return (checkout / "config" / "NODE.md").read_text(encoding="utf-8")


def fenced_lines(text: str) -> list[str]:
    """The lines inside code fences."""
    lines, inside = [], False
    for line in text.splitlines():
        if line.lstrip().startswith("```"):
            inside = not inside
        elif inside:
            lines.append(line.strip())
    assert not inside, "a code fence is left open"
    return lines


def section(text: str, title: str) -> str:
    """What stands under a heading, up to the next one of the same depth."""
    found = re.split(r"^## (.*)$", text, flags=re.MULTILINE)
    assert found[1::2].count(title) == 1
    return found[found.index(title) + 1]


def table_rows(text: str) -> list[list[str]]:
    """Cells of the first table in a text, without its header."""
    lines = []
    for line in text.splitlines():
        if line.startswith("|"):
            lines.append([cell.strip() for cell in line.strip("|").split(" |")])
        elif lines:
            break
    assert len(lines) > 2
    return lines[2:]


def named(text: str) -> list[str]:
    """Everything in single backticks."""
    return re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S))


PAGES = ["README.md", "config/README.md", "config/NODE.md", "config/METHODS.md"]


@pytest.mark.parametrize("page", [*PAGES, "CONTRIBUTING.md"])
def test_generated_parts_are_what_the_code_says(checkout, page):
    text = (checkout / page).read_text(encoding="utf-8")
    found, made = readme_blocks.found_blocks(text), readme_blocks.PAGES.get(page, {})
    assert set(found) == set(made)
    for name, make in made.items():
        assert found[name] == make(), "run `python test/readme_blocks.py`"
        assert len(found[name].splitlines()) > 5


@pytest.mark.parametrize(
    "start",
    [
        "python3 -m venv .venv",
        ".venv/bin/pip install '.[ros,plots,test]'",
        ".venv/bin/dlo_sim demo",
        ".venv/bin/python -m pytest",
    ],
)
def test_command_that_ci_runs_is_there_once(readme, start):
    found = [line for line in fenced_lines(readme) if line.startswith(start)]
    assert len(found) == 1
    shlex.split(found[0])


def test_commands_in_the_readme_are_accepted(readme):
    used = set()
    for line in fenced_lines(readme):
        words = shlex.split(line, comments=True)
        if not words or words[0].rpartition("/")[2] != "dlo_sim":
            continue
        used.add(words[1])
        if words[1] != "node":  # its arguments are for ROS
            _parser().parse_args(words[1:])
    assert used == set(SUBCOMMANDS), "each subcommand is shown"
    assert "ros2 run dlo_sim node --ros-args --params-file" in readme


@pytest.mark.parametrize("page", [*PAGES, "CONTRIBUTING.md"])
def test_files_that_a_page_names_exist(checkout, page):
    text = (checkout / page).read_text(encoding="utf-8")
    linked = re.findall(r"\]\(([^)#:]+)\)", text)
    folder = (checkout / page).parent
    assert [name for name in linked if not (folder / name).exists()] == []
    spoken = [name for name in named(text) if re.match(r"(config|test|resource)/[\w./]+$", name)]
    assert [name for name in spoken if not (checkout / name).exists()] == []
    assert linked or spoken


def test_scene_in_the_readme_is_accepted(readme, tmp_path):
    (code,) = re.findall(r"```yaml\n(.*?)```", readme, re.DOTALL)
    (tmp_path / "my_cable.yaml").write_text(code)
    assert load_scene(tmp_path / "my_cable.yaml").start.driven


def test_every_shipped_scene_is_shown(readme):
    shown = set(re.findall(r"^\| `config/(\w+)\.yaml`", readme, re.MULTILINE))
    assert shown == set(shipped_scenes())


def test_table_of_topics_is_complete(node_page):
    scene = scene_from_values(
        {
            "cable.length": 1.0,
            "start.pose_topic": "~/start/pose",
            "end.pose_topic": "~/end/pose",
            "end.fixed": [True, True, True],
            "loads.names": ["start", "end", "force"],
            "loads.force.type": "force",
            "grasps.names": ["hand", "camera"],
            "grasps.hand.pose_topic": "~/hand/pose",
            "grasps.camera.pose_topic": "~/camera/points",
            "grasps.camera.pose_type": "two_points",
            "grasps.camera.taken_topic": "~/camera/taken",
            "outputs.points": True,
            "outputs.tf": True,
            "outputs.capsules": 10,
            "forecast.processes": 1,
            "obstacles.names": ["floor"],
            "branches.names": ["lamp"],
            "branches.lamp.end.fixed": [True, True, True],
            "branches.lamp.end.pose_topic": "~/hand/pose",
            "cables.names": ["rope"],
            "cables.rope.end.fixed": [True, True, True],
            "connectors.names": ["plug"],
            "connectors.plug.mass": 0.1,
            "connectors.plug.inertia": [1e-5] * 3,
            "connectors.plug.shape": "sphere",
            "connectors.plug.size": [0.1, 0.0, 0.0],
        }
    )
    alone = scene_from_values({"measured.type": "point_cloud", "contact.markers": 1})
    listened = (*input_topics(scene), *plan_topics(scene), *input_topics(alone))
    wanted = {(entry.topic, "in", entry.type) for entry in listened}
    wanted |= {(topic, "out", kind) for topic, kind in output_topics(scene).items()}
    names = "hand|camera|lamp|rope|plug"
    wanted = {(re.sub(names, "<name>", topic), *more) for topic, *more in wanted}
    shown = set()
    for names, direction, kind, meaning in table_rows(section(node_page, "Topics")):
        shown |= {(name, direction, kind) for name in named(names)}
        assert meaning
    assert shown == wanted


def test_parameters_named_in_the_text_exist(checkout):
    known = {row.key for row in scene_parameters(("<name>", "force"), *[("<name>",)] * 5)}
    groups = {key.partition(".")[0] for key in known if "." in key}
    text = "\n".join((checkout / page).read_text(encoding="utf-8") for page in PAGES)
    text = re.sub(r"<!-- parameters:begin.*?parameters:end -->", "", text, flags=re.DOTALL)
    keys = {re.split(r"[:=]", name)[0].strip() for name in named(text)}
    keys = {key for key in keys if key.partition(".")[0] in groups and "." in key}
    assert len(keys) > 10
    assert keys <= known


def test_python_examples_run(readme, checkout, monkeypatch):
    """As scripts; what their names are afterwards."""
    monkeypatch.chdir(checkout)
    names, batch = {"__name__": "__main__"}, {"__name__": "__main__"}
    codes = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    for code, found in zip(codes, (names, batch), strict=True):
        exec(compile(code, "README.md", "exec"), found)
    assert names["tip"][1] > 0.05, "the hand has pulled the free end towards y"
    assert names["force"][2] > 1.0, "the gripper carries the cable"
    assert batch["result"].ok
    assert (batch["sag"] < -0.01).all(), "the wires fall"
