"""Simulations that agree in bits on processors whose BLAS rounds differently."""

import processors
import pytest


def test_bits_do_not_follow_the_kernels_of_blas():
    """Cables that hang, lie on a table, have a natural shape, and take explicit steps."""
    scenes = ("table", "two_grippers", "paper_wire", str(processors.CABLES / "DLO1.yaml"))
    one, other = processors.by_core(processors.CORES, scenes).values()
    if one.pop("BLAS") == other.pop("BLAS"):
        pytest.skip("this BLAS does not take its kernels from OPENBLAS_CORETYPE")
    assert one == other
