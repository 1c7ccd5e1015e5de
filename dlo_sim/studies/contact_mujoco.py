"""Cables of MuJoCo that touch things: reads jobs (JSON, stdin) and prints a result for each.

A script that `contact_peers` runs with a Python interpreter that has MuJoCo; nothing of dlo_sim is
imported, and MuJoCo only here and by `main`. A cable of n links is built straight along x from the
end that a cart may carry, and bent into its initial shape through the joint coordinates. Its
models:
    composite: MuJoCo 3's composite cable, capsules on ball joints with the elasticity plugin, whose
        stiffness is integrated explicitly.
    flex: MuJoCo 4's one-dimensional flex, a discrete elastic rod whose vertices slide in the plane
        and whose edges are kept by constraints.
    hinges: capsules on hinges with springs, a chain that moves in the plane only; both generations.
Stiffness is implicit in the last two, with the integrator `discrete`.
"""

from __future__ import annotations

import importlib
import json
import sys
import time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

mujoco: Any = None  # set by `main`: the interpreter that runs dlo_sim may not have it

INERTIA = 1e5  # [kg] of the cart, whose speed is prescribed
SOFT_TWIST = 1e6  # [Pa]; nothing twists, and the true stiffness would require smaller steps
LIGHT = 'pos="0 0 0" mass="1e-3" diaginertia="1e-9 1e-9 1e-9"'
PLANE = 'type="plane" size="5 5 0.1"'
PLUGIN = '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>'
HINGE = '<joint type="hinge" axis="0 1 0" {}/>'
SLIDES = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'


class Cable:
    """The cable of a job in motion; `run` once."""

    def __init__(self, job: dict[str, Any]) -> None:
        self.job, self.step, self.held = job, job["step"], job["held"]
        self.path = np.array(job["path"])
        self.link = np.linalg.norm(self.path[1] - self.path[0])
        # Of a clamp, the middle of the first link is held.
        self.first = -0.5 * self.link if self.held == "clamped" else 0.0
        self.stiff = f'solref="{job["time_constant"]} 1" solimp="{job["impedance"]}"'
        self.touch = f'condim="{job["dimensions"]}" friction="{job["friction"]} 0 0" {self.stiff}'
        build = {"composite": self._composite, "hinges": self._hinges, "flex": self._flex}
        head, cable, tail, end = build[job["model"]]()
        ground = PLANE
        if job["drum"]:  # a long capsule: cheaper than a cylinder, with exact distances
            ground = f'type="capsule" fromto="0 -0.1 0 0 0.1 0" size="{job["drum"]}"'
        self.model = mujoco.MjModel.from_xml_string(
            f"""<mujoco>{head}
            <option timestep="{self.step}" gravity="0 0 {-job["gravity"]}" solver="Newton"
              integrator="{"Euler" if job["model"] == "composite" else "discrete"}"
              cone="{job["cone"]}" impratio="{job["impratio"]}" tolerance="1e-10"/>
            <worldbody><site name="origin"/><geom name="ground" {ground} {self.touch}/>{cable}
            </worldbody>{tail}<actuator><motor site="{end}" refsite="origin"
              gear="{text(job["force"])} 0 0 0"/></actuator></mujoco>"""
        )
        if self.held != "free":
            self.model.body("cart").pos = self.path[0] - self.first * self._direction(0)
        self.data = mujoco.MjData(self.model)
        self.data.ctrl[:] = 1.0
        self._bend()
        self._drive(0.0)

    def _direction(self, k: int) -> NDArray[np.float64]:
        """Of a link."""
        return (self.path[k + 1] - self.path[k]) / self.link

    def _cart(self, inside: str) -> str:
        """A cable in a cart that slides where it is drawn; a free one without a cart."""
        if self.held == "free":
            return inside
        return f"""<body name="cart"><inertial {LIGHT}/><joint name="cart" type="slide"
            axis="{text(self.job["velocity"])}" armature="{INERTIA}"/>{inside}</body>"""

    def _geom(self) -> str:
        """Attributes of a link, which touches nothing but the ground."""
        job = self.job
        return f"""type="capsule" size="{job["radius"]}" mass="{job["mu"] * self.link:.12g}"
            contype="0" conaffinity="1" {self.touch}"""

    def _hinges(self) -> tuple[str, str, str, str]:
        job, link = self.job, self.link
        spring = job["EI"] / link
        begun = {"free": SLIDES + HINGE.format(""), "clamped": "", "pinned": HINGE.format("")}
        between = HINGE.format(
            f'stiffness="{spring:.12g}" damping="{spring * job["damping"]:.12g}"'
        )
        chain = f'<site name="last" pos="{link} 0 0"/>'
        for k in reversed(range(job["n"])):
            chain = f"""<body pos="{link if k else self.first:.12g} 0 0">
                {between if k else begun[self.held]}
                <geom fromto="0 0 0 {link:.12g} 0 0" {self._geom()}/>{chain}</body>"""
        return "", self._cart(chain), "", "last"

    def _composite(self) -> tuple[str, str, str, str]:
        job = self.job
        modulus = job["EI"] / (0.25 * np.pi * job["radius"] ** 4)
        initial = {"free": "free", "clamped": "none", "pinned": "ball"}[self.held]
        cable = f"""<composite prefix="c" type="cable" initial="{initial}"
              vertex="{text(np.outer(np.arange(job["n"] + 1) * self.link, [1.0, 0.0, 0.0]))}">
            <plugin plugin="mujoco.elasticity.cable">
              <config key="twist" value="{min(modulus / 3.0, SOFT_TWIST):.12g}"/>
              <config key="bend" value="{modulus:.12g}"/></plugin>
            <joint kind="main" damping="{job["EI"] / self.link * job["damping"]:.12g}"/>
            <geom {self._geom()}/></composite>"""
        if self.held == "clamped":
            cable = f'<body pos="{self.first:.12g} 0 0">{cable}</body>'
        return PLUGIN, self._cart(cable), "", "cS_last"

    def _carried(self) -> int:
        """Number of vertices of a flex in the cart."""
        return {"free": 0, "pinned": 1, "clamped": 2}[self.held]

    def _flex(self) -> tuple[str, str, str, str]:
        job, link, n, carried = self.job, self.link, self.job["n"], self._carried()
        places = np.outer(self.first + np.arange(n + 1) * link, [1.0, 0.0, 0.0])
        balls = ""
        for k in range(carried, n + 1):
            mass = job["mu"] * link * (0.5 if k in (0, n) else 1.0)
            balls += f"""<body name="v{k}" pos="{text(places[k])}"><inertial pos="0 0 0"
                mass="{mass:.12g}" diaginertia="1e-12 1e-12 1e-12"/>{SLIDES}
                <site name="s{k}"/></body>"""
        names = ["cart"] * carried + [f"v{k}" for k in range(carried, n + 1)]
        places[carried:] = 0.0  # a vertex is given in the frame of its body
        modulus = job["EI"] / (0.25 * np.pi * job["radius"] ** 4)
        tail = f"""<deformable><flex name="cable" radius="{job["radius"]}" dim="1"
              body="{" ".join(names)}" vertex="{text(places)}"
              element="{" ".join(f"{k} {k + 1}" for k in range(n))}">
            <elasticity young="{modulus:.12g}" damping="{job["damping"]}"/>
            <contact selfcollide="none" contype="0" conaffinity="1" {self.touch}/></flex>
            </deformable><equality><flex flex="cable" {self.stiff}/></equality>"""
        return "", self._cart("") + balls, tail, f"s{n}"

    def _bend(self) -> None:
        """Set the joint coordinates such that the links lie on the path."""
        q, model, plane = self.data.qpos, self.job["model"], [0, 2]
        if model == "flex":
            carried = self._carried()
            straight = [self.model.body(f"v{k}").pos for k in range(carried, self.job["n"] + 1)]
            q[2 * carried - 2 * len(self.path) :] = np.ravel(
                (self.path[carried:] - straight)[:, plane]
            )
            return
        ways = np.diff(self.path, axis=0)
        turns = np.diff(np.arctan2(-ways[:, 2], ways[:, 0]), prepend=0.0)
        turns = turns[1:] if self.held == "clamped" else turns
        if self.held == "free":
            q[: 2 if model == "hinges" else 3] = self.path[0][plane if model == "hinges" else ...]
        if model == "hinges":
            q[-len(turns) :] = turns
        else:
            half, zero = 0.5 * turns, np.zeros(len(turns))
            q[-4 * len(turns) :] = np.ravel(np.array([np.cos(half), zero, np.sin(half), zero]).T)

    def _drive(self, now: float) -> None:
        """Prescribe the speed of the cart."""
        if self.held != "free":
            drawn = now < self.job["drawn"] - 0.5 * self.step
            self.data.joint("cart").qvel = drawn * np.linalg.norm(self.job["velocity"])

    def _measure(self) -> list[float]:
        """What the job asks for, from the contact forces on the cable."""
        job, data, force, moment = self.job, self.data, np.zeros(3), 0.0
        if job["measured"] == "kinetic energy":
            mujoco.mj_energyVel(self.model, data)
            return [data.energy[1]]
        ground, wrench = self.model.geom("ground").id, np.zeros(6)
        for k in range(data.ncon):
            one = data.contact[k]
            mujoco.mj_contactForce(self.model, data, k, wrench)
            on_second = one.frame.reshape(3, 3).T @ wrench[:3]
            on_cable = on_second if one.geom[0] == ground else -on_second
            force += on_cable
            moment += on_cable[2] * one.pos[0]
        if job["measured"] == "pull":
            along = np.array(job["velocity"]) / np.linalg.norm(job["velocity"])
            return [-(force + job["force"]) @ along]
        length = self.path[-1, 0]  # the lifted end is at x = 0
        weight = job["mu"] * job["gravity"] * length
        values = [weight - force[2], 0.5 * weight * length - moment]
        return values[: 2 if self.held == "clamped" else 1]

    def run(self) -> tuple[list[float], float]:
        """Mean of the measured values after `settled` [s], and processor time of the steps [s]."""
        job, seconds, found = self.job, 0.0, []
        chunk = max(1, round(job["every"] / self.step))
        for k in range(1, round(job["duration"] / (chunk * self.step)) + 1):
            began = time.process_time()
            mujoco.mj_step(self.model, self.data, nstep=chunk)
            seconds += time.process_time() - began
            now = k * chunk * self.step
            if any(warning.number for warning in self.data.warning):
                raise RuntimeError(f"MuJoCo warned and reset itself at {now:g} s")
            if now > job["settled"]:
                found.append(self._measure())
            self._drive(now)
        return np.mean(found, axis=0).tolist(), seconds


def text(numbers: ArrayLike) -> str:
    """Numbers for MuJoCo's XML."""
    return " ".join(f"{number:.12g}" for number in np.ravel(numbers))


def main() -> None:
    """Repeat every job within its time budget; the reply has a message if a run failed."""
    global mujoco
    mujoco = importlib.import_module("mujoco")
    for job in json.load(sys.stdin):
        values: list[float] = []
        seconds: list[float] = []
        message = ""
        try:
            while not seconds or (len(seconds) < job["repeats"] and sum(seconds) < job["budget"]):
                values, took = Cable(job).run()
                seconds.append(took)
        except Exception as refusal:  # whatever the simulator raises
            message = str(refusal).split("\n")[0]
        reply = {"version": mujoco.__version__, "values": values, "seconds": seconds}
        print(json.dumps({**reply, "message": message}), flush=True)


if __name__ == "__main__":
    main()
