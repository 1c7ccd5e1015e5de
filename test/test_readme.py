"""What README.md says is what the code does."""

import re
import shlex

import pytest

from dlo_sim.scene.parameters import markdown_table


@pytest.fixture(scope="module")
def readme(checkout) -> str:
    return (checkout / "README.md").read_text(encoding="utf-8")


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


def test_parameter_table_is_the_one_of_the_code(readme):
    found = re.findall(
        r"<!-- parameters:begin.*?-->\n(.*?)\n<!-- parameters:end -->", readme, re.DOTALL
    )
    assert len(found) == 1
    assert found[0].strip() == markdown_table(), "paste the output of `dlo_sim parameters`"


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


def test_subcommands_in_the_readme_exist(readme):
    from dlo_sim.cli.main import SUBCOMMANDS

    used = set(re.findall(r"(?:^|/|\s)dlo_sim ([a-z]+)", "\n".join(fenced_lines(readme))))
    used -= {"node"} if "ros2 run dlo_sim node" in readme else set()
    assert used, "no subcommand is shown"
    assert used <= set(SUBCOMMANDS)
