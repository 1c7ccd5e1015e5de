"""Simulations that agree in bits on processors whose BLAS rounds differently."""

import json

import processors
import pytest
from test_sideways import HOSE

SCENES = {
    "slack over a table": {
        "start.position": [0.0, 0.0, 0.1],
        "start.tangent": [0.8, 0.0, 0.6],
        "end.position": [0.6, 0.1, 0.2],
        "end.tangent": [0.6, 0.0, 0.8],
        "obstacles.names": ["table"],
        "obstacles.table.shape": "plane",
    },
    "arc that falls over": {
        "start.clamped": False,
        "end.clamped": False,
        "end.position": [0.5, 0.0, 0.0],
        "gravity": [0.0, 0.0, 9.81],
        "initial.shape": "straight",
        "terms.out_of_plane": "on",
    },
}


def test_bits_do_not_follow_the_kernels_of_blas(tmp_path):
    """Cables that hang, lie on a table, have a natural shape, take explicit steps, come to rest
    over a table with their twist, and fall over out of a plane.
    """
    scenes = ["table", "two_grippers", "paper_wire", str(processors.CABLES / "DLO1.yaml")]
    for name, values in SCENES.items():
        path = tmp_path / f"{name}.yaml"
        path.write_text(json.dumps({"/**": {"ros__parameters": HOSE | values}}), encoding="utf-8")
        scenes.append(str(path))
    one, other = processors.by_core(processors.CORES, scenes).values()
    if one.pop("BLAS") == other.pop("BLAS"):
        pytest.skip("this BLAS does not take its kernels from OPENBLAS_CORETYPE")
    assert one == other
