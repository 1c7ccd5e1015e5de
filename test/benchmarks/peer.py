"""Cables of other simulators: `peer.py NAME` reads jobs (JSON, stdin) and prints a result for each.

Run by the Python interpreter of that simulator, whose environment need not have dlo_sim: nothing of
it is imported. Each class is a cable of a job in motion with a time step `step` [s]:
    look(first, steps): observed points [m], shape (m, 3), before so many steps from step number
        `first`, which may be prepared here; raises if the previous steps failed.
    advance(first, steps): these steps and nothing else, because they are timed.
"""

import json
import sys
import time

import numpy as np

try:
    from numba import njit
except ModuleNotFoundError:  # in the environments of other simulators, which run no chain

    def njit(cache):
        """Nothing is compiled."""
        return lambda function: function


PIECES = 3  # timed pieces of a run that is too slow to be completed
SOFT_TWIST = 1e6  # [Pa]
LIGHT = 1e-3  # [kg], mass of MuJoCo 3's sliders; lighter ones make the connection too soft


class Chain:
    """A naive chain: lumped masses, discrete-rod bending, stiff links, velocity Verlet, compiled.
    The simplest implementation, for comparison.
    """

    most_steps = np.inf

    def __init__(self, job):
        n, kind = job["n"], job["kind"]
        clamps = {"pinned": 0, "hanging": 0, "cantilever": 1, "clamped": 2}[kind]
        link = job["length"] / (n - 0.5 * clamps)
        first = -0.5 * link if clamps else 0.0
        self.x = np.outer(first + np.arange(n + 1) * link, job["direction"])
        self.v = np.zeros_like(self.x)
        mass = np.full(n + 1, job["mu"] * link)
        mass[[0, n]] *= 0.5
        free = np.ones((n + 1, 3))
        if kind == "pinned":
            free[[0, n], 1:] = 0.0
        elif kind == "hanging":
            free[0] = 0.0
        else:
            free[:2] = 0.0
        if kind == "clamped":
            free[-2:] = 0.0
        waves = 2.0 / link * np.sqrt(job["EA"] / job["mu"])
        bends = 4.0 / link**2 * np.sqrt(job["EI"] / job["mu"])
        tau = 0.93 * 2.0 / np.hypot(waves, bends)
        self.step = job["every"] / np.ceil(job["every"] / tau)
        spring = job["spring"] if kind == "pinned" else 0.0
        constants = (job["EA"], job["EI"], spring, job["length"], job["damping"])
        push = np.array([*job["force"], job["frequency"]])
        closing = np.array([job["closed"] if kind == "clamped" else 0.0, job["closing"]])
        self.rest = (self.step, link, constants, mass, free, push, closing)
        self.observed = [round(u * n) for u in job["observed"]]

    def look(self, first, steps):
        """Observed points."""
        return self.x[self.observed]

    def advance(self, first, steps):
        """Steps."""
        advance_chain(self.x, self.v, first, steps, *self.rest)


@njit(cache=True)
def chain_force(x, link, axial, bending, mass, spring, length, f):
    """Forces on all points: gravity, links, bending, end springs along x."""
    n = x.shape[0] - 1
    for i in range(n + 1):
        f[i, 0] = 0.0
        f[i, 1] = 0.0
        f[i, 2] = -9.81 * mass[i]
    f[0, 0] -= spring * x[0, 0]
    f[n, 0] -= spring * (x[n, 0] - length)
    for i in range(n):
        a0, a1, a2 = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1], x[i + 1, 2] - x[i, 2]
        a = np.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
        pull = axial * (a / link - 1.0) / a
        f[i, 0] += pull * a0
        f[i, 1] += pull * a1
        f[i, 2] += pull * a2
        f[i + 1, 0] -= pull * a0
        f[i + 1, 1] -= pull * a1
        f[i + 1, 2] -= pull * a2
        if i == n - 1:
            break
        b0, b1 = x[i + 2, 0] - x[i + 1, 0], x[i + 2, 1] - x[i + 1, 1]
        b2 = x[i + 2, 2] - x[i + 1, 2]
        b = np.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
        # U = 2 B / l (|a||b| - a.b) / (|a||b| + a.b), tan^2 of half the angle
        p, q = a * b, a0 * b0 + a1 * b1 + a2 * b2
        slope = 4.0 * bending / link / (p + q) ** 2
        u, v = slope * q * b / a, slope * q * a / b  # with dU = slope (q dp - p dq)
        w = slope * p
        g0, g1, g2 = u * a0 - w * b0, u * a1 - w * b1, u * a2 - w * b2
        h0, h1, h2 = v * b0 - w * a0, v * b1 - w * a1, v * b2 - w * a2
        f[i, 0] += g0
        f[i, 1] += g1
        f[i, 2] += g2
        f[i + 1, 0] += h0 - g0
        f[i + 1, 1] += h1 - g1
        f[i + 1, 2] += h2 - g2
        f[i + 2, 0] -= h0
        f[i + 2, 1] -= h1
        f[i + 2, 2] -= h2


@njit(cache=True)
def advance_chain(x, v, first, steps, tau, link, constants, mass, free, push, closing):
    """Advance by whole steps from step number `first`."""
    axial, bending, spring, length, decay = constants
    n = x.shape[0] - 1
    f = np.zeros_like(x)
    damp = np.exp(-0.5 * decay * tau)
    for k in range(first, first + steps + 1):
        if k > first:
            for i in range(n + 1):
                for d in range(3):
                    x[i, d] += tau * v[i, d]
            if closing[0] > 0.0:
                half = 0.5 * closing[1]
                s = min(k * tau, 2.0 * half) / half
                share = 0.5 * s * s if s < 1.0 else 1.0 - 0.5 * (2.0 - s) ** 2
                x[n - 1, 0] = length - closing[0] * share - 0.5 * link
                x[n, 0] = x[n - 1, 0] + link
        chain_force(x, link, axial, bending, mass, spring, length, f)
        sine = np.sin(2.0 * np.pi * push[3] * k * tau)
        for d in range(3):
            f[n // 2, d] += push[d] * sine
        # The half kick that ends the previous step, and the one that starts the next.
        for i in range(n + 1):
            for d in range(3):
                kick = 0.5 * tau * f[i, d] / mass[i] * free[i, d]
                if k > first:
                    v[i, d] = (v[i, d] + kick) * damp
                if k < first + steps:
                    v[i, d] = v[i, d] * damp + kick


class MuJoCo:
    """MuJoCo 3: the composite cable with the elasticity plugin, a chain of capsules on ball joints.
    MuJoCo 4: the one-dimensional flex, a discrete elastic rod whose edges are kept by constraints.
    Both are inextensible; the wire's end springs include its axial compliance.
    """

    most_steps = np.inf

    def __init__(self, job):
        import mujoco

        build = self._composite if mujoco.__version__.startswith("3.") else self._flex
        self.mujoco, self.job, self.step = mujoco, job, job["step"]
        options, body, observed = build(job)
        self.model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="{self.step}" gravity="0 0 -9.81" integrator="Euler"
            iterations="50" tolerance="1e-10" {options}><flag contact="disable"/></option>
            {body}</mujoco>"""
        )
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self.spots = [(self.model.body(name).id, np.array(place)) for name, place in observed]

    @staticmethod
    def _held(job):
        """What both need: length of a link [m], of which a clamp is at the middle of the outermost;
        spring of the wire's end in series with half of the wire [N/m]; the constraints, as stiff as
        the step allows and critically damped.
        """
        link = job["length"] / (job["n"] - 0.5 * (job["kind"] == "cantilever"))
        springs = [1.0 / job["spring"], 0.5 * job["length"] / job["EA"]] if job["spring"] else [1.0]
        stiff = f'solref="{max(2.0 * job["step"], 2e-4)} 1" solimp="0.9999 0.9999 0.001"'
        return link, 1.0 / sum(springs), stiff

    def _composite(self, job):
        n, pinned, (link, spring, stiff) = job["n"], job["kind"] == "pinned", self._held(job)
        loose, radius = pinned or job["kind"] == "hanging", 0.5 * job["diameter"]
        slider = f"""<joint type="slide" axis="1 0 0" stiffness="{spring:.12g}"/>
            <inertial mass="{LIGHT}" diaginertia="1e-9 1e-9 1e-9" pos="0 0 0"/>"""
        # These cables do not twist, and the true stiffness would require smaller steps.
        body = f"""<extension><plugin plugin="mujoco.elasticity.cable"/></extension>
            <worldbody><body name="A" pos="{0.0 if loose else -0.5 * link:.12g} 0 0">
            {slider if pinned else ""}
            <composite prefix="c" type="cable" initial="{"ball" if loose else "none"}"
              vertex="{text(np.outer(np.arange(n + 1) * link, job["direction"]))}">
            <plugin plugin="mujoco.elasticity.cable">
              <config key="twist" value="{min(job["shear_modulus"], SOFT_TWIST):.12g}"/>
              <config key="bend" value="{job["youngs_modulus"]:.12g}"/></plugin>
            <joint kind="main" damping="0"/>
            <geom type="capsule" size="{radius:.12g}" mass="{job["mu"] * link:.12g}"/>
            </composite></body>"""
        if pinned:
            body += f"""<body name="B" pos="{job["length"]} 0 0">{slider}</body></worldbody>
                <equality><connect body1="cB_last" body2="B" anchor="{link:.12g} 0 0" {stiff}/>
                </equality>"""
        else:
            body += "</worldbody>"
        last = ("cB_last", [link, 0.0, 0.0])
        spots = [last if u == 1.0 else (f"cB_{n // 2}", [0.0] * 3) for u in job["observed"]]
        return 'solver="PGS" jacobian="dense"', body, spots

    def _flex(self, job):
        n, pinned, (link, spring, stiff) = job["n"], job["kind"] == "pinned", self._held(job)
        held, radius = {"pinned": 0, "hanging": 1}.get(job["kind"], 2), 0.5 * job["diameter"]
        first = -0.5 * link if held == 2 else 0.0
        places = np.outer(first + np.arange(n + 1) * link, job["direction"])
        balls = ""
        for k in range(held, n + 1):
            end = k in (0, n)
            axes = ["1 0 0"] if pinned and end else ["1 0 0", "0 1 0", "0 0 1"]
            along = f'stiffness="{spring:.12g}"' if len(axes) == 1 else ""
            balls += f"""<body name="v{k}" pos="{text(places[k])}"><inertial pos="0 0 0"
                mass="{job["mu"] * link * (0.5 if end else 1.0):.12g}"
                diaginertia="1e-12 1e-12 1e-12"/>"""
            balls += "".join(f'<joint type="slide" axis="{axis}" {along}/>' for axis in axes)
            balls += "</body>"
        names = ["world"] * held + [f"v{k}" for k in range(held, n + 1)]
        places[held:] = 0.0  # a vertex is given in the frame of its body
        body = f"""<worldbody>{balls}</worldbody><deformable>
            <flex name="cable" radius="{radius:.12g}" dim="1" body="{" ".join(names)}"
              vertex="{text(places)}" element="{" ".join(f"{k} {k + 1}" for k in range(n))}">
            <elasticity young="{job["youngs_modulus"]:.12g}" shear="{job["shear_modulus"]:.12g}"/>
            <contact selfcollide="none" contype="0" conaffinity="0"/></flex></deformable>
            <equality><flex flex="cable" {stiff}/></equality>"""
        return 'solver="Newton"', body, [(f"v{round(u * n)}", [0.0] * 3) for u in job["observed"]]

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
            self.mujoco.mj_applyFT(self.model, self.data, push, np.zeros(3), spot, body, applied)
        x, turn = self.data.xpos, self.data.xmat.reshape(-1, 3, 3)
        return np.array([x[k] + turn[k] @ place for k, place in self.spots])

    def advance(self, first, steps):
        """Steps."""
        self.mujoco.mj_step(self.model, self.data, nstep=steps)


class PyElastica:
    """PyElastica's Cosserat rod. Its shear stiffness and the rotary inertia of its sections limit
    steps to 0.1 to 1 us on thin stiff cables. If that is too slow, a short piece gives the cost of
    a simulated second, without an error.
    """

    most_steps = 400_000

    def __init__(self, job):
        import elastica

        class Scene(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing):
            """A system with constraints and forces, composed of PyElastica's mixins."""

        self.scene, self.step, n = Scene(), job["step"], job["n"]
        self.rod = elastica.CosseratRod.straight_rod(
            *(n, np.zeros(3), np.array(job["direction"]), np.array([0.0, 1.0, 0.0])),
            *(job["length"], 0.5 * job["diameter"], job["density"]),
            youngs_modulus=job["youngs_modulus"],
            shear_modulus=job["shear_modulus"],
        )
        self.scene.append(self.rod)
        gravity = {"acc_gravity": np.array([0.0, 0.0, -9.81])}
        self.scene.add_forcing_to(self.rod).using(elastica.GravityForces, **gravity)
        held = {"constrained_position_idx": (0,)}
        if job["kind"] == "cantilever":
            held["constrained_director_idx"] = (0,)
            self.scene.constrain(self.rod).using(elastica.OneEndFixedBC, **held)
        elif job["kind"] == "hanging":
            self.scene.constrain(self.rod).using(elastica.GeneralConstraint, **held)
        self.scene.finalize()
        self.stepper = elastica.PositionVerlet()
        self.observed = [round(u * n) for u in job["observed"]]

    def look(self, first, steps):
        """Observed points."""
        return self.rod.position_collection[:, self.observed].T

    def advance(self, first, steps):
        """Steps."""
        now = first * self.step
        for _ in range(steps):
            now = self.stepper.step(self.scene, now, self.step)


PEERS = {"chain": (Chain, ""), "mujoco": (MuJoCo, "mujoco"), "elastica": (PyElastica, "elastica")}


def text(numbers):
    """Numbers for MuJoCo's XML."""
    return " ".join(f"{number:.12g}" for number in np.ravel(numbers))


def run(peer, job):
    """One run: times, observed points (T, m, 3) and run time of stepping, without the first piece,
    which may compile. A run that is too slow has a few pieces only, and no points.
    """
    cable = peer(job)
    chunk = max(1, round(job["every"] / cable.step))
    pieces = round(job["duration"] / (chunk * cable.step))
    whole = pieces * chunk <= peer.most_steps
    times, points, walls = [], [], []
    for k in range((pieces if whole else PIECES) + 1):
        times.append(k * chunk * cable.step)
        points.append(cable.look(k * chunk, chunk).tolist())
        if not np.abs(points[-1]).max() < 10 * job["length"]:
            raise RuntimeError(f"diverged at {times[-1]:g} s")
        began = time.perf_counter()
        cable.advance(k * chunk, chunk)
        walls.append(time.perf_counter() - began)
    wall = float(np.mean(walls[1:])) * pieces
    return {"times": times, "points": points if whole else [], "step": cable.step}, wall


def main():
    """Repeat every job within its time budget; the reply has a message if a run failed."""
    peer, package = PEERS[sys.argv[1]]
    try:
        version = getattr(__import__(package), "__version__", "") if package else ""
    except ModuleNotFoundError as absent:
        sys.exit(f"{sys.executable} has no {absent.name}")
    for job in json.load(sys.stdin):
        found, message = {"times": [], "points": [], "step": job["step"]}, ""
        walls: list[float] = []
        try:
            while not walls or (len(walls) < job["repeats"] and sum(walls) < job["budget"]):
                found, wall = run(peer, job)
                walls.append(wall)
        except Exception as refusal:  # whatever the simulator raises
            message = str(refusal).split("\n")[0]
        print(json.dumps({"version": version, **found, "walls": walls, "message": message}))


if __name__ == "__main__":
    main()
