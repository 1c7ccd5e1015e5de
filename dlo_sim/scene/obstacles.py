"""What a scene says of obstacles, and of contact with them and of the cable with itself."""

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dlo_sim.scene.parameter import IN_TEXT, ORIGIN, SWITCH, Group, Quaternion, Vector, parameter
from dlo_sim.scene.refusal import Rules

LEAST_CELLS = 8  # of a mesh's field
LEAST_QUATERNION = 1e-3  # norm below which an orientation is refused
LEAST_SIZE = 1e-9  # [m], of an obstacle
LEAST_STIFFNESS = 1e-6  # [N/m^2], of contact

SHAPES = ("plane", "box", "sphere", "cylinder", "capsule", "ring", "channel", "mesh")


@dataclass(frozen=True)
class Contact(Group):
    """Contact of the cable with obstacles and with itself: what they have in common.

    Parameters:
        self_contact: Whether the cable touches itself, with contact.friction, instead of passing
            through itself; needs energy_momentum or implicit_midpoint. auto = off, with a warning
            where it passes through.
        stiffness: Contact force per unit length and penetration depth; 0 = chosen for each
            obstacle, so that the weight on earth presses the cable in by a thousandth of its
            diameter, landing at 2 m/s or usual tension round an edge by a fiftieth, and so on
            (config/METHODS.md).
        restitution: Speed at which the cable leaves an obstacle that it hits, as a fraction of that
            at which it came: 0 = it lies where it lands, 1 = it bounces without loss.
        damping: Fraction of critical damping where the cable touches itself: 0 = it bounces.
        friction: Coefficient of friction of the cable on itself, and on obstacles that have none of
            their own.
        markers: Largest number of obstacles that markers on ~/obstacles add while the node runs;
            0 = it does not listen there.
    """

    self_contact: str = parameter("auto", choices=SWITCH)
    stiffness: float = parameter(0.0, "N/m^2", (0.0, 1.0e12))
    restitution: float = parameter(0.0, "", (0.0, 1.0))
    damping: float = parameter(0.3, "", (0.0, 10.0))
    friction: float = parameter(0.0, "", (0.0, 100.0))
    markers: int = parameter(0, "", (0, 1000), read_only=True)

    def conflicts(self, key: str, scene: Any) -> Rules:
        """Contact that is next to none, and markers without contact, with terms.contact `off`."""
        if 0.0 < self.stiffness < LEAST_STIFFNESS:
            yield "stiffness", f"is below {LEAST_STIFFNESS:g}; give 0 to have it chosen"
        if self.markers and scene.terms.contact == "off":
            why = "since terms.contact is off; set it to auto"
            yield "markers", f"obstacles would do nothing, {why}"


@dataclass(frozen=True)
class Obstacle(Group):
    """A rigid body that the cable cannot enter.

    Parameters:
        shape: plane: the half-space below the plane through position, normal to the obstacle's z
            axis; box; sphere; cylinder; capsule; ring: an eyelet through which the cable runs, a
            torus; channel: a tube open at both ends, with round rims; the latter four about the z
            axis; mesh: a closed surface of triangles.
        size: Extent along its x, y and z axes. A sphere has the diameter x; a cylinder and a
            capsule have the diameter x and the length z, that of a capsule with its caps; a ring
            has an opening of diameter x and a wire of thickness y; a channel an opening of diameter
            x, a wall of thickness y and the length z; a plane and a mesh have none.
        position: Its centre, or of a plane a point on its surface; in `frame` if there is one.
        orientation: Quaternion x, y, z, w of its axes, world frame, or `frame` if there is one.
        mesh: File of the mesh (STL, OBJ, PLY, GLB or DAE; needs the extra `mesh`): a path relative
            to the scene's file (to the working directory if there is none), or
            package://PACKAGE/PATH. All its bodies are one obstacle.
        mesh_scale: Factor from the lengths in the file to m: 0.001 for an STL file in mm. DAE files
            name their unit, which is known.
        mesh_cells: Cells of the grid of distances along the longest side of the mesh. Edges and
            openings, and walls thinner than two cells, are rounded by about a cell; 0 = chosen: 48,
            or as many as make cells no larger than the cable's radius, up to a million in all.
        friction: Coefficient of Coulomb friction of the cable on it; auto (-1) = contact.friction.
        pose_topic: Topic of its pose (PoseStamped), which moves it; empty = it rests.
        frame: tf2 frame to which it is attached and with which it moves, such as that of a table or
            of a link of the robot. Without tf2, in a simulation from Python or the command line,
            this frame is the world frame.
        pose_timeout: Time without poses after which the last pose is held, with a warning.
        pose_smoothing: Half the window of a local quadratic fit that smooths noisy poses; 0 = off.
    """

    name: str
    shape: str = parameter("plane", choices=SHAPES)
    size: Vector = parameter((0.1, 0.1, 0.1), "m", (0.0, 1.0e6))
    position: Vector = parameter(ORIGIN, "m", (-1.0e8, 1.0e8))
    orientation: Quaternion = parameter((0.0, 0.0, 0.0, 1.0), "", (-1.0, 1.0))
    mesh: str = parameter("")
    mesh_scale: float = parameter(1.0, "", (1.0e-9, 1.0e9))
    mesh_cells: int = parameter(0, "", (0, 2000))
    friction: float = parameter(-1.0, "", (0.0, 100.0), auto=-1.0)
    pose_topic: str = parameter("", read_only=True)
    frame: str = parameter("", read_only=True)
    pose_timeout: float = parameter(1.0, "s", (0.01, 3600.0))
    pose_smoothing: float = parameter(0.0, "s", (0.0, 1.0))

    @property
    def tf_frame(self) -> str:
        """`frame`, which an end effector has under this name."""
        return self.frame

    @property
    def driven(self) -> bool:
        """Whether poses from a topic or tf2 move it."""
        return bool(self.pose_topic or self.frame)

    @property
    def normal(self) -> Vector:
        """Unit vector of its z axis, the outward normal of a plane."""
        return self.axes[2]

    @property
    def axes(self) -> tuple[Vector, Vector, Vector]:
        """Unit vectors of its axes."""
        size = math.hypot(*self.orientation)
        x, y, z, w = (part / size for part in self.orientation)
        return (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
            (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
            (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
        )

    @property
    def mesh_url(self) -> str:
        """Where other programs find the file of its mesh; empty for triangles without a file."""
        if self.mesh.startswith(IN_TEXT):
            return ""
        if "://" in self.mesh:
            return self.mesh
        return Path(os.path.expanduser(self.mesh)).absolute().as_uri()

    def pushes_along(self, axis: int, place: float) -> bool:
        """Whether it can push a cable out of the plane normal to a world axis, at this place on it:
        unless it is mirrored in that plane, or a prism across it, which of a mesh is not known.
        """
        if self.shape == "plane":
            return self.normal[axis] != 0.0
        away = abs(self.position[axis] - place)
        if self.shape == "mesh":
            return True
        if self.shape == "sphere":
            return away != 0.0
        rounding = {"capsule": self.size[0], "channel": self.size[1]}.get(self.shape, 0.0)
        for extent, direction in zip(self.size, self.axes, strict=True):
            if abs(direction[axis]) == 1.0:
                prism = self.shape == "box" or (direction == self.axes[2] and self.shape != "ring")
                return away > (0.5 * (extent - rounding) if prism else 0.0)
        return True

    def conflicts(self, key: str, scene: Any) -> Rules:
        """A shape without a file, extents or axes; a frame that is none."""
        shape, size = self.shape, self.size
        if shape == "mesh" and not self.mesh:
            yield "mesh", "is no file; give a mesh file, or another shape"
        if 0 < self.mesh_cells < LEAST_CELLS:
            yield "mesh_cells", f"are too few; give {LEAST_CELLS} or more, or 0 to have them chosen"
        used = {"plane": 0, "mesh": 0, "sphere": 1, "ring": 2}.get(shape, 3)
        least = min(size[:used], default=LEAST_SIZE)
        if least < LEAST_SIZE:
            what = f"{least:g} m where a {shape} needs more"
            if least == 0.0:
                what = f"a zero that a {shape} needs"
            yield "size", f"has {what}; give its extents, or remove it"
        elif shape in ("ring", "channel") and size[0] <= scene.cable.diameter:
            through = f"through which a cable of {scene.cable.diameter:g} m does not go"
            cure = "give a wider one, or a thinner cable"
            yield "size", f"has an opening of {size[0]:g} m, {through}; {cure}"
        elif shape == "channel" and size[2] < size[1]:
            cure = "make it longer, or take a ring"
            yield "size", f"is a channel shorter than its wall is thick; {cure}"
        if math.hypot(*self.orientation) < LEAST_QUATERNION:
            yield "orientation", "is no rotation; give x, y, z, w, [0.0, 0.0, 0.0, 1.0] for none"
        if self.frame and self.pose_topic:
            yield "frame", f"gives the pose; remove it or {key}.pose_topic"
        if self.frame.startswith("/"):
            yield "frame", f"is no frame of tf2; give {self.frame.lstrip('/') or 'table'}"
        if self.frame == scene.frame_id:
            yield "frame", "is the world frame, frame_id, in which obstacles rest; remove it"
