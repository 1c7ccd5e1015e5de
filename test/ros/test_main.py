"""The process around the node: its help, and a machine without ROS."""

from __future__ import annotations

import subprocess
import sys

import pytest

from dlo_sim.ros import DONE, REFUSED
from dlo_sim.ros.main import main

WITHOUT = """
import sys
sys.modules |= dict.fromkeys({names})
from dlo_sim.ros.main import main
sys.exit(main([]))
"""


@pytest.mark.parametrize(
    ("names", "cure"),
    [
        (["rclpy", "rcl_interfaces", "geometry_msgs"], "pip install 'dlo_sim[ros]'"),
        (["rosbags"], "pip install rosbags"),
    ],
)
def test_without_ros_or_rosbags_one_line_names_the_cure(names: list[str], cure: str) -> None:
    if cure == "pip install rosbags":
        pytest.importorskip("rclpy")
    code = WITHOUT.format(names=names)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == REFUSED
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert cure in line


def test_help_names_the_params_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == DONE
    assert "--params-file" in capsys.readouterr().out
