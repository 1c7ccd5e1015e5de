"""Which node a name in a parameter file means, as ROS decides it."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

import rclpy
from rclpy.context import Context
from rclpy.node import Node

from dlo_sim.scene.loading import is_for_node

NODES = [("/", "dlo_sim"), ("/left", "dlo_sim"), ("/left/arm", "dlo_sim"), ("/", "right")]
PATTERNS = [
    *("/dlo_sim", "/other", "/**", "/*", "/**/dlo_sim", "/*/dlo_sim", "/left/dlo_sim", "/left/*"),
    *("/left/**", "/**/left/dlo_sim", "/left/arm/dlo_sim", "/*/*/dlo_sim", "/left/*/dlo_sim"),
    *("/left/**/dlo_sim", "/**/arm/**", "/DLO_SIM", "/**/*"),
]


@pytest.mark.parametrize(("namespace", "name"), NODES)
def test_a_name_in_a_file_means_what_ros_takes_it_for(
    tmp_path: Path, domain: int, namespace: str, name: str
) -> None:
    """A parameter of its own for every name, with and without the slash; who gets which?"""
    spelled = [*PATTERNS, *(pattern.removeprefix("/") for pattern in PATTERNS)]
    files = []
    for index, pattern in enumerate(spelled):
        path = tmp_path / f"{index}.yaml"
        path.write_text(f"'{pattern}':\n  ros__parameters:\n    p{index}: 1\n", encoding="utf-8")
        files += ["--params-file", str(path)]
    remaps = ["-r", f"__ns:={namespace}", "-r", f"__node:={name}"]
    context = Context()
    rclpy.init(args=["--ros-args", *files, *remaps], context=context, domain_id=domain)
    node = Node(
        "dlo_sim",
        context=context,
        allow_undeclared_parameters=True,
        automatically_declare_parameters_from_overrides=True,
    )
    full_name = node.get_fully_qualified_name()
    given = [p for i, p in enumerate(spelled) if node.has_parameter(f"p{i}")]
    node.destroy_node()
    rclpy.try_shutdown(context=context)
    assert full_name == f"{namespace.rstrip('/')}/{name}"
    assert given
    assert given == [p for p in spelled if is_for_node(f"/{p.removeprefix('/')}", full_name)]
