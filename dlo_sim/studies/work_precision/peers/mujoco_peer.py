"""MuJoCo's cables.

MuJoCo 3: the composite cable with the elasticity plugin, a chain of capsules on ball joints.
MuJoCo 4: the one-dimensional flex, a discrete elastic rod whose edges are kept by constraints.
Both are inextensible; the wire's end springs include its axial compliance.
"""

import contextlib
import xml.etree.ElementTree as ElementTree

import numpy as np

with contextlib.suppress(ModuleNotFoundError):  # this file is also imported without it
    import mujoco

PACKAGE = "mujoco"
SOFT_TWIST = 1e6  # [Pa]
LIGHT = 1e-3  # [kg], mass of MuJoCo 3's sliders; lighter ones make the connection too soft


def element(parent, tag, **attributes):
    """A child element; numbers and lists become text."""
    words = {key: text(value) for key, value in attributes.items()}
    return ElementTree.SubElement(parent, tag, words)


def text(value):
    """A value as text for MuJoCo's XML."""
    if isinstance(value, str):
        return value
    return " ".join(f"{float(v):.12g}" for v in np.ravel(value))


def model_of(job):
    """The XML of a job, and the observed points: names of bodies, positions in their frames."""
    root = ElementTree.Element("mujoco")
    option = element(root, "option", timestep=job["step"], gravity=[0, 0, -9.81])
    option.set("integrator", "Euler")
    option.set("iterations", "50")
    element(option, "flag", contact="disable")
    build = composite if mujoco.__version__.startswith("3.") else flex
    observed = build(root, option, job)
    return ElementTree.tostring(root, encoding="unicode"), observed


def softer_spring(job):
    """Spring [N/m] equivalent to the wire's end spring in series with half of the wire."""
    return 1.0 / (1.0 / job["spring"] + 0.5 * job["length"] / job["EA"])


def link_length(job):
    """Length of a link [m]; a clamp is at the middle of the outermost link."""
    return job["length"] / (job["n"] - 0.5 * (job["kind"] == "cantilever"))


def hold(job):
    """Constraint parameters: as stiff as the step allows, and critically damped."""
    constant = max(2.0 * job["step"], 2e-4)
    return {"solref": [constant, 1.0], "solimp": [0.9999, 0.9999, 0.001]}


def composite(root, option, job):
    """MuJoCo 3."""
    option.set("solver", "PGS")
    option.set("jacobian", "dense")
    option.set("tolerance", "1e-10")
    n, link, kind = job["n"], link_length(job), job["kind"]
    plugin = "mujoco.elasticity.cable"
    element(element(root, "extension"), "plugin", plugin=plugin)
    world = element(root, "worldbody")
    first = 0.0 if kind in ("pinned", "hanging") else -0.5 * link
    holder = element(world, "body", name="A", pos=[first, 0, 0])
    tiny = {"mass": LIGHT, "diaginertia": [1e-9] * 3, "pos": [0, 0, 0]}
    if kind == "pinned":
        slide = {"type": "slide", "axis": [1, 0, 0], "stiffness": softer_spring(job)}
        element(holder, "joint", **slide)
        element(holder, "inertial", **tiny)
    vertices = np.outer(np.arange(n + 1) * link, job["direction"])
    initial = "ball" if kind in ("pinned", "hanging") else "none"
    cable = element(holder, "composite", prefix="c", type="cable", vertex=vertices, initial=initial)
    rod = element(cable, "plugin", plugin=plugin)
    # These cables do not twist, and the true value would require smaller steps.
    element(rod, "config", key="twist", value=min(job["shear_modulus"], SOFT_TWIST))
    element(rod, "config", key="bend", value=job["youngs_modulus"])
    element(cable, "joint", kind="main", damping=0.0)
    element(cable, "geom", type="capsule", size=0.5 * job["diameter"], mass=job["mu"] * link)
    if kind == "pinned":
        far = element(world, "body", name="B", pos=[job["length"], 0, 0])
        element(far, "joint", **slide)
        element(far, "inertial", **tiny)
        tie = element(root, "equality")
        element(tie, "connect", body1="cB_last", body2="B", anchor=[link, 0, 0], **hold(job))
    tip = [link, 0.0, 0.0]
    return [("cB_last", tip) if u == 1.0 else (f"cB_{n // 2}", [0.0] * 3) for u in job["observed"]]


def flex(root, option, job):
    """MuJoCo 4."""
    option.set("solver", "Newton")
    option.set("tolerance", "1e-10")
    n, link, kind = job["n"], link_length(job), job["kind"]
    world = element(root, "worldbody")
    first = 0.0 if kind in ("pinned", "hanging") else -0.5 * link
    held = {"pinned": 0, "hanging": 1}.get(kind, 2)
    bodies, vertices = [], []
    for k in range(n + 1):
        place = (first + k * link) * np.array(job["direction"])
        if k < held:
            bodies.append("world")
            vertices.append(place)
        else:
            mass = job["mu"] * link * (0.5 if k in (0, n) else 1.0)
            ball = element(world, "body", name=f"v{k}", pos=place)
            element(ball, "inertial", pos=[0, 0, 0], mass=mass, diaginertia=[1e-12] * 3)
            loose = range(1 if kind == "pinned" and k in (0, n) else 3)
            for axis in loose:
                spring = softer_spring(job) if len(loose) == 1 else 0.0
                unit = np.eye(3)[axis]
                element(ball, "joint", type="slide", axis=unit, stiffness=spring)
            bodies.append(f"v{k}")
            vertices.append([0.0, 0.0, 0.0])
    rod = element(element(root, "deformable"), "flex", name="cable", radius=0.5 * job["diameter"])
    rod.set("dim", "1")
    rod.set("body", " ".join(bodies))
    rod.set("vertex", text(vertices))
    rod.set("element", " ".join(f"{k} {k + 1}" for k in range(n)))
    element(rod, "elasticity", young=job["youngs_modulus"], shear=job["shear_modulus"])
    still = element(rod, "contact", selfcollide="none")
    still.set("contype", "0")
    still.set("conaffinity", "0")
    element(element(root, "equality"), "flex", flex="cable", **hold(job))
    return [(f"v{round(u * n)}", [0.0] * 3) for u in job["observed"]]


class Cable:
    """A cable in motion; see `serve`."""

    def __init__(self, job):
        xml, observed = model_of(job)
        self.job, self.step = job, job["step"]
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self.spots = [(self.model.body(name).id, np.array(place)) for name, place in observed]

    def look(self, first, steps):
        """Observed points; also sets the force, that at the middle of the steps."""
        if any(warning.number for warning in self.data.warning):
            raise RuntimeError(f"MuJoCo warned and reset itself at {first * self.step:g} s")
        middle = (first + 0.5 * steps) * self.step
        push = np.array(self.job["force"]) * np.sin(2.0 * np.pi * self.job["frequency"] * middle)
        if push.any():
            body, applied = self.spots[0][0], self.data.qfrc_applied
            spot = self.data.xpos[body].copy()
            applied[:] = 0.0
            mujoco.mj_applyFT(self.model, self.data, push, np.zeros(3), spot, body, applied)
        frames = [(self.data.xpos[k], self.data.xmat[k].reshape(3, 3)) for k, _ in self.spots]
        places = (place for _, place in self.spots)
        return np.array([x + turn @ place for (x, turn), place in zip(frames, places, strict=True)])

    def advance(self, first, steps):
        """Steps."""
        mujoco.mj_step(self.model, self.data, nstep=steps)
