"""The process around the node: its help, and a machine without ROS."""

from __future__ import annotations

import subprocess
import sys

import pytest

from dlo_sim.ros.main import DONE, REFUSED, main

WITHOUT_ROS = """
import sys
for name in ("rclpy", "rcl_interfaces", "geometry_msgs"):
    sys.modules[name] = None
from dlo_sim.ros.main import main
sys.exit(main([]))
"""


def test_without_ros_one_line_names_the_cure() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == REFUSED
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert "pip install 'dlo_sim[ros]'" in line


def test_help_names_the_params_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == DONE
    assert "--params-file" in capsys.readouterr().out
