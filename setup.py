"""Packaging of dlo_sim, for pip and for colcon (ament_python)."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "dlo_sim"
ROOT = Path(__file__).resolve().parent
MESH = ["trimesh>=5", "pycollada"]  # STL, OBJ, PLY and GLB; DAE


def version() -> str:
    """The version, from the package itself without importing it."""
    text = (ROOT / NAME / "__init__.py").read_text(encoding="utf-8")
    found = re.search(r'^__version__ = "([^"]+)"$', text, re.MULTILINE)
    if found is None:
        raise RuntimeError(f"{NAME}/__init__.py holds no __version__")
    return found.group(1)


def shipped(folder: str) -> list[str]:
    """Scenes, launch file and views of a folder, relative to this file, for setuptools."""
    kinds = {".yaml", ".py", ".rviz", ".json"}
    return sorted(
        f"{folder}/{path.name}" for path in (ROOT / folder).iterdir() if path.suffix in kinds
    )


setup(
    name=NAME,
    version=version(),
    description="Simulation and prediction of cables: ROS 2 node, bag replay, and tools",
    long_description=(ROOT / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    license_files=["LICENSE"],
    maintainer="dlo_sim maintainers",
    maintainer_email="dlo_sim@example.org",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"], f"{NAME}.view": ["page.html", "page.js"]},
    python_requires=">=3.11",
    # .ci/run tries the lowest versions. Pythons that numba does not know are refused by numba.
    install_requires=["numpy>=1.26", "numba>=0.58.1", "mcap", "rosbags", "ruamel.yaml", "tqdm"],
    extras_require={
        # ROS from wheels, for machines without a ROS installation; never mix it with a sourced one.
        "ros": ["ros-jazzy-rclpy[fastrtps]", "ros-jazzy-common-interfaces"],
        # Pictures and studies.
        "plots": ["matplotlib", "scipy"],
        # Mesh files of obstacles.
        "mesh": MESH,
        # Fits to recordings.
        "identify": ["scipy"],
        # Studies and batches on more than one machine.
        "dask": ["distributed"],
        "test": [*MESH, "hypothesis", "pytest", "pytest-xdist", "scipy", "setuptools"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", shipped("config")),
        (f"share/{NAME}/config/cables", shipped("config/cables")),
    ],
    entry_points={
        "console_scripts": [
            "dlo_sim = dlo_sim.__main__:main",
            "node = dlo_sim.__main__:node",
        ]
    },
    # `ros2 run` looks for executables in lib/<package>; this takes the place of a setup.cfg.
    options={
        "develop": {"script_dir": f"$base/lib/{NAME}"},
        "install": {"install_scripts": f"$base/lib/{NAME}"},
    },
    zip_safe=False,
)
