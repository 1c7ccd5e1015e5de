"""Extreme scenes, ordinary for users of stiff, thin, long or short cables: their materials,
supports and loads as flat scene keys, their runs with actions at given times, and checks of the
results against an independent result if there is one, or else the energy balance.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from closed_forms import catenary, elastica_gap, euler_load, momenta, string_deflection
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
Values = dict[str, Any]
Action = Callable[[Simulator], Simulator | None]

RAN, REFUSED, STOPPED = "ran", "refused", "stopped"
# The study measures the method, not the tolerance of its solver.
TIGHT: Values = {"integrator.tolerance": 1e-10}
BUDGET = 30.0  # [s], largest run time of a scene
PIECES = 50  # calls per run, between which the budget is checked


@dataclass
class Run:
    """A run in progress: its present simulator, the control points at its start (n, 4); over all
    simulators of the run, the largest energy error, numbers of steps and iterations, run time [s],
    and why it ended early.
    """

    simulator: Simulator
    first: Array
    energy_error: float = 0.0
    steps: int = 0
    iterations: int = 0
    wall: float = 0.0
    message: str = ""

    @property
    def scene(self) -> Scene:
        """The scene of the present simulator."""
        return self.simulator.scene

    @property
    def cells(self) -> list[Any]:
        """Cells of the table: energy error, method, step [s], steps, iterations, run time [s]."""
        simulator = self.simulator
        counts = (self.steps, self.iterations, self.wall)
        return [self.energy_error, simulator.method, simulator.step, *counts]


Check = Callable[[Run], float]


@dataclass(frozen=True)
class Extreme:
    """An extreme scene, its duration [s], the `check` that gives the error of a finished run and
    describes it in its docstring, the `bound` on that error, and events (time [s], action) in
    order of time.
    """

    name: str
    what: str
    values: Values
    duration: float
    check: Check
    bound: float
    events: tuple[tuple[float, Action], ...] = ()


@dataclass(frozen=True)
class Finding:
    """Result of an extreme scene: `run` is None if it was refused, `error` is None unless it ran to
    its end."""

    extreme: Extreme
    outcome: str
    reason: str = ""
    error: float | None = None
    run: Run | None = None

    @property
    def of_what(self) -> str:
        """Description of the error."""
        return (self.extreme.check.__doc__ or "").partition("\n")[0]

    @property
    def right(self) -> bool:
        """Whether it ran to its end with finite results and an error within the bound."""
        if self.error is None or self.run is None:
            return False
        finite = bool(np.isfinite(self.run.simulator.control_points).all())
        return finite and self.error <= self.extreme.bound


def examine(extreme: Extreme, share: float = 1.0) -> Finding:
    """Run a scene, or the first `share` of it, and check the result."""
    run = None
    try:
        simulator = Simulator(scene_from_values(TIGHT | extreme.values))
        run = Run(simulator, simulator.control_points)
        last = extreme.duration * share
        for moment, action in (*extreme.events, (last, lambda simulator: None)):
            if not _advance_to(run, min(moment, last)):
                return Finding(extreme, STOPPED, run.message, run=run)
            if moment < last:
                run.simulator = action(run.simulator) or run.simulator
    except SceneError as refusal:
        return Finding(extreme, REFUSED, str(refusal), run=run)
    return Finding(extreme, RAN, error=float(extreme.check(run)), run=run)


def _advance_to(run: Run, until: float) -> bool:
    """Advance by whole steps up to a time of the present simulator [s]; return success."""
    simulator = run.simulator
    target = round(until / simulator.step)
    piece = max((target - simulator.steps) // PIECES, 1)
    while simulator.steps < target:
        began = time.perf_counter()
        report = simulator.advance_steps(min(piece, target - simulator.steps))
        run.wall += time.perf_counter() - began
        run.steps += report.steps
        run.iterations += report.force_evaluations
        run.energy_error = max(run.energy_error, simulator.energy_error)
        run.message = "" if report.status.advanced else report.message
        if not run.message and run.wall > BUDGET and simulator.steps < target:
            run.message = f"its budget of {BUDGET:g} s was used up at {simulator.time:.6g} s"
        if run.message:
            return False
    return True


def push(load: str, *force: float) -> Action:
    """Set the force [N] of a load."""
    return lambda simulator: simulator.set_load(load, force=force)


def jump(end: str, *way: float) -> Action:
    """Displace an end instantaneously [m]."""
    return lambda simulator: simulator.set_end(end, position=simulator.end_pose(end)[0] + way)


def turn(end: str, angle: float) -> Action:
    """Rotate an end about x instantaneously, to an angle [rad]."""
    half = (np.sin(0.5 * angle), 0.0, 0.0, np.cos(0.5 * angle))
    return lambda simulator: simulator.set_end(end, orientation=half)


def move(end: str, velocity: float, duration: float) -> Action:
    """Move an end along x with a velocity [m/s] for a time [s]."""

    def begin(simulator: Simulator) -> None:
        position, orientation = simulator.end_pose(end)
        motion = EndMotion(
            start=simulator.time,
            duration=duration,
            position=position,
            orientation=orientation,
            velocity=(velocity, 0.0, 0.0),
        )
        simulator.set_motion(end, motion)

    return begin


def reconfigure(key: str, value: float) -> Action:
    """Change a value of the scene, which must not change the shape."""

    def change(simulator: Simulator) -> Simulator:
        other = simulator.reconfigured(simulator.scene.with_values({key: value}))
        if not np.array_equal(simulator.control_points, other.control_points):
            raise RuntimeError("reconfiguring changed the shape")
        return other

    return change


PULSE = 0.01  # [s]
PULSES = {"left": (3.0, 1.0, -2.0), "right": (-1.0, 0.5, 2.5)}  # [N] at u = 0 and u = L
TURN = 2.0  # [rad]
BIG_PULSE = (1e6, 1e-3)  # [N], [s]


def energy_balance(run: Run) -> float:
    """energy balance, share of the energy exchanged"""
    return run.energy_error


def lasting(run: Run) -> float:
    """displacement, share of L; energy balance"""
    return max(_moved(run), run.energy_error)


def hangs_as_catenary(run: Run) -> float:
    """distance from the elastic catenary, share of L"""
    scene, cable = run.scene, run.scene.cable
    u = np.linspace(0.0, cable.length, 201)
    span = scene.end.position[0] - scene.start.position[0]
    x, z = catenary(u, cable.length, span, cable.mu * -scene.gravity[2], cable.EA)
    shape = run.simulator.centerline(u) - np.asarray(scene.start.position)
    return float(np.hypot(shape[:, 0] - x, shape[:, 2] - z).max() / cable.length)


def sags_as_cantilever(run: Run) -> float:
    """tip deflection, relative to q L^4 / 8 EI"""
    cable = run.scene.cable
    expected = cable.mu * -run.scene.gravity[2] * cable.length**4 / (8.0 * cable.EI)
    return _off(-run.simulator.control_points[-1, 2], expected)


def pulls_as_string(run: Run) -> float:
    """deflection, relative to an elastic string"""
    force = float(np.linalg.norm(run.scene.load("pull").force))
    return _off(_deflection(run), _of_string(run, force))


def swings_about_string(run: Run) -> float:
    """energy balance, share of the energy exchanged

    Infinite if it moved by less than 1 % of the length.
    """
    return run.energy_error if _moved(run) > 1e-2 else np.inf


def follows_string(run: Run) -> float:
    """mean deflection, relative to an elastic string; 1000 times the energy balance

    Averaged over fast small oscillations; the string is under the load's present force.
    """
    load, found, force = run.scene.load("pull"), [], []
    for _ in range(20):
        run.simulator.advance_steps(1)
        found.append(_deflection(run))
        share = np.sin(2.0 * np.pi * load.frequency * run.simulator.time)
        force.append(np.linalg.norm(load.force) * abs(share))
    expected = _of_string(run, float(np.mean(force)))
    return max(_off(float(np.mean(found)), expected), 1e3 * run.energy_error)


def weighs_its_weight(run: Run) -> float:
    """reaction, relative to the weight"""
    cable = run.scene.cable
    force, _ = run.simulator.reaction("start")
    weight = cable.mu * cable.length * np.asarray(run.scene.gravity)
    return float(np.abs(force + weight).max() / np.linalg.norm(weight))


def is_taut(run: Run) -> float:
    """tension, relative to EA (gap / L - 1)"""
    cable = run.scene.cable
    start, end = (run.simulator.end_pose(name)[0] for name in ("start", "end"))
    force, _ = run.simulator.reaction("end")
    stretch = float(np.linalg.norm(end - start)) / cable.length - 1.0
    return _off(float(np.linalg.norm(force)), cable.EA * stretch)


def keeps_momentum(run: Run) -> float:
    """momentum against the pulses, and angular momentum over another second, relative"""
    momentum, angular = momenta(run.simulator)
    impulse = PULSE * np.sum(list(PULSES.values()), axis=0)
    run.simulator.advance(1.0)
    _, later = momenta(run.simulator)
    return max(_off(momentum, impulse), _off(later, angular))


def carries_impulse(run: Run) -> float:
    """momentum, relative to the impulse"""
    momentum, _ = momenta(run.simulator)
    return _off(momentum, np.array([0.0, 0.0, BIG_PULSE[0] * BIG_PULSE[1]]))


def turns_as_rod(run: Run) -> float:
    """moment, relative to GJ Theta / L; displacement off the axis, share of L"""
    cable = run.scene.cable
    _, moment = run.simulator.reaction("end")
    return max(_off(abs(moment[0]), cable.GJ * TURN / cable.length), _off_axis(run))


def stays_straight(run: Run) -> float:
    """displacement off the axis, share of L; energy balance"""
    return max(_off_axis(run), run.energy_error)


def amplifies_as_column(run: Run) -> float:
    """buckling load, relative to EI pi^2 / L^2

    From the sag of the column, which the load amplifies to w0 / (1 - P / Pc).
    """
    scene, cable = run.scene, run.scene.cable
    side = scene.load("side").force[2]
    first_mode = 2.0 * side * cable.length**3 / (np.pi**4 * cable.EI)
    sag = run.simulator.centerline([0.5 * cable.length])[0, 2]
    buckling = abs(scene.load("press").force[0]) / (1.0 - first_mode / sag)
    return _off(buckling, euler_load(scene))


def buckles_as_elastica(run: Run) -> float:
    """distance of the ends, against the elastica, share of L"""
    length = run.scene.cable.length
    share = abs(run.scene.load("press").force[0]) / euler_load(run.scene)
    first, last = run.simulator.centerline([0.0, length])[:, 0]
    return float(abs((last - first) / length - elastica_gap(share)))


def closes_ring(run: Run) -> float:
    """distance of the ends, share of L"""
    points = run.simulator.control_points
    return float(np.linalg.norm(points[-1, :3] - points[0, :3]) / run.scene.cable.length)


def mirrors(run: Run) -> float:
    """asymmetry, share of L; energy balance"""
    shape = _shape(run.simulator)
    mirrored = shape[::-1] * np.array([-1.0, 1.0, 1.0])
    middle = np.array([shape[0, 0] + shape[-1, 0], 0.0, 0.0])
    gap = np.abs(shape - mirrored - middle).max() / run.scene.cable.length
    return float(max(gap, run.energy_error))


def rests_as_undamped(run: Run) -> float:
    """distance from the undamped equilibrium, share of L"""
    plain = dict.fromkeys(("damping.mass", "damping.stiffness", "damping.air_drag"), 0.0)
    still = Simulator(run.scene.with_values({**plain, "initial.shape": "equilibrium"}))
    gap = np.linalg.norm(_shape(run.simulator) - _shape(still), axis=1).max()
    return float(gap / run.scene.cable.length)


def _shape(simulator: Simulator) -> Array:
    """101 points of the centerline [m]."""
    return simulator.centerline(np.linspace(0.0, simulator.scene.cable.length, 101))


def _moved(run: Run) -> float:
    """Largest displacement of a control point along an axis since the start, share of L."""
    moved = np.abs(run.simulator.control_points - run.first)[:, :3].max()
    return float(moved / run.scene.cable.length)


def _deflection(run: Run) -> float:
    """Deflection of the middle along y [m]."""
    return float(abs(run.simulator.centerline([0.5 * run.scene.cable.length])[0, 1]))


def _of_string(run: Run, force: float) -> float:
    """Deflection [m] of an elastic string under a force [N] in its middle."""
    cable = run.scene.cable
    return string_deflection(force, cable.EA, cable.length, cable.EI)


def _off_axis(run: Run) -> float:
    """Largest distance of control points from the x axis, share of L."""
    points = run.simulator.control_points
    return float(np.abs(points[:, 1:3]).max() / run.scene.cable.length)


def _off(found: ArrayLike, expected: ArrayLike) -> float:
    """Relative difference of two numbers or vectors."""
    gap = np.linalg.norm(np.subtract(found, expected))
    return float(gap / np.linalg.norm(np.asarray(expected)))


def at(step: float, n: int = 13) -> Values:
    """energy_momentum with a step [s] and n control points."""
    values = {"integrator.step": step, "discretization.control_points": n}
    return values | {"integrator.method": "energy_momentum", "terms.twist": "off"}


def material(length: float, diameter: float, density: float, modulus: float) -> Values:
    """A round cable of an isotropic material with Poisson's ratio 0.3."""
    return {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.density": density,
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": modulus / 2.6,
    }


def damped(mass: float = 2.0, stiffness: float = 1e-3) -> Values:
    """Damping by mass [1/s] and by stiffness [s]."""
    return {"damping.mass": mass, "damping.stiffness": stiffness}


def ends(start: float, end: float) -> Values:
    """Both ends held on the x axis [m]."""
    places = {"start.position": [start, 0.0, 0.0], "end.position": [end, 0.0, 0.0]}
    return places | {"start.fixed": [True] * 3, "end.fixed": [True] * 3}


PLANE: Values = {"terms.out_of_plane": "off"}
SPACE: Values = {"terms.out_of_plane": "on"}
FLAT: Values = {"gravity": [0.0, 0.0, 0.0]}
STRAIGHT: Values = {"initial.shape": "straight"}
AT_REST: Values = {"initial.shape": "equilibrium"}
CANTILEVER: Values = {"start.clamped": True, "end.fixed": [False] * 3}
DRIVEN: Values = {"start.pose_topic": "/start", "end.pose_topic": "/end"}
GUIDED: Values = {  # the paper's wire
    "start.fixed": [False, True, True],
    "end.fixed": [False, True, True],
    "start.spring": [1e4, 0.0, 0.0],
    "end.spring": [1e4, 0.0, 0.0],
    "end.position": [2.0, 0.0, 0.0],
}
ALUMINIUM = material(2.0, 2e-3, 2700.0, 69e9)
STEEL = material(2.0, 2e-3, 7850.0, 200e9)
NYLON = material(1.0, 2e-3, 1150.0, 2e9)
SOFT = material(1.0, 5e-3, 1200.0, 1e7)


def load(name: str, position: float, force: tuple[float, float, float], signal: str) -> Values:
    """A force at a share of the length; with signal `none` it is zero until it is set."""
    load = {"type": "force", "position": position, "signal": signal, "force": list(force)}
    return {f"loads.{name}.{key}": value for key, value in load.items()}


def wire(metal: Values, step: float = 2e-3) -> Values:
    """The paper's wire."""
    return at(step) | PLANE | metal | GUIDED | STRAIGHT


def suture(density: float, signal: str) -> Values:
    """The collagen suture, held at both ends and pulled at the middle with 1 N."""
    pull = load("pull", 0.5, (0.0, 1.0, 0.0), signal) | {"loads.names": ["pull"]}
    pull["loads.pull.frequency"] = 0.125  # [Hz]: peak after 2 s
    cable = material(0.1, 4e-4, density, 750e6) | ends(0.0, 0.1)
    return at(1e-3, 40) | SPACE | FLAT | cable | pull | STRAIGHT


def pinned_line(length: float, diameter: float, density: float, modulus: float, n: int) -> Values:
    """A cable pinned at both ends 0.9 lengths apart, at rest.

    Its bending stiffness is a hundredth of a solid rod's, as for a stranded line: the catenary that
    it is compared with has none.
    """
    bending = 0.01 * modulus * np.pi * diameter**4 / 64.0
    cable = material(length, diameter, density, modulus) | {"cable.bending_stiffness": bending}
    return at(2e-3, n) | PLANE | cable | ends(0.0, 0.9 * length)


def thrown(cable: Values, step: float, *names: str) -> Values:
    """A free cable with loads that are zero until they are set."""
    places = {"left": 0.0, "right": 1.0, "pull": 0.5}
    values: Values = {"loads.names": list(names), "start.fixed": [False] * 3}
    for name in names:
        values |= load(name, places[name], (0.0, 0.0, 0.0), "none")
    return at(step) | SPACE | FLAT | cable | values | {"end.fixed": [False] * 3}


def column(share: float, side: float = 1e-5) -> Values:
    """Pinned column under a share of its Euler load, with `side` of it across the middle."""
    modulus, diameter = 1e9, 5e-3
    euler = np.pi**2 * modulus * np.pi * diameter**4 / 64.0
    press = load("press", 1.0, (-share * euler, 0.0, 0.0), "constant")
    press |= load("side", 0.5, (0.0, 0.0, side * euler), "constant")
    press |= {"loads.names": ["press", "side"], "end.fixed": [False, True, True]}
    cable = material(1.0, diameter, 1200.0, modulus)
    return at(1e-3, 40) | PLANE | FLAT | cable | press | AT_REST


HARD_STEPS = (1e-6, 1e-5, 1e-4, 1e-2, 1e-1)  # [s]; 2 ms is the wire itself
AUTO: Values = {"integrator.method": "auto", "integrator.step": 0.0}
LIGHT, HEAVY = 3.0, 1300.0  # density of the suture [kg/m^3]
GRIPPED = at(2e-3) | PLANE | SOFT | DRIVEN
HOSE = at(5e-3) | PLANE | material(2.0, 0.05, 1100.0, 5e6) | CANTILEVER | damped(2.0, 0.05)
SLACK = at(5e-4) | PLANE | NYLON | DRIVEN | ends(0.0, 0.9) | damped()
SLACK["gravity"] = [0.0, 0.0, -0.01]
SWINGING = at(1e-3) | PLANE | material(1.0, 5e-3, 1200.0, 1e6) | ends(0.0, 0.9) | STRAIGHT
TWISTED = at(1e-3) | SPACE | FLAT | SOFT | DRIVEN | ends(0.0, 1.0) | damped()
TWISTED |= {"start.clamped": True, "end.clamped": True, "terms.twist": "quasistatic"}
RING = at(1e-3, 40) | PLANE | FLAT | SOFT | CANTILEVER | AT_REST
RING["cable.rest_curvature"] = [2.0 * np.pi]
FIBRE = at(2e-3) | PLANE | material(0.05, 125e-6, 2200.0, 72e9) | CANTILEVER | AT_REST
LINE = pinned_line(100.0, 0.02, 2700.0, 70e9, 400)
HANGING = pinned_line(1.0, 5e-3, 1200.0, 1e7, 13)
SETTLING, VISCOUS = HANGING | damped(20.0) | STRAIGHT, HANGING | damped(1e4, 1.0) | AT_REST
LONG = pinned_line(1e3, 0.03, 7850.0, 200e9, 100)
FINE: Values = {"discretization.control_points": 2000}


def _wire(name: str, what: str, values: Values, bound: float, duration: float = 10.0) -> Extreme:
    return Extreme(name, what, values, duration, energy_balance, bound)


def _stepped(tau: float) -> Extreme:
    name, duration = f"step of {tau * 1e3:g} ms", 10.0 if tau >= 1e-2 else 2000 * tau
    return _wire(name, f"aluminium wire, {duration:g} s", wire(ALUMINIUM, tau), 1e-7, duration)


def _pulled(density: float, more: Values) -> Extreme:
    name = f"suture of {density:g} kg/m^3{', automatic' if more else ''}"
    what = "10 cm, r 0.2 mm, E 750 MPa, n_u 40, pulled to 1 N at the middle in 2 s, undamped"
    values = suture(density, "sine") | more
    return Extreme(name, what, values, 2.0, follows_string, 5e-3)


def _sudden(density: float, more: Values) -> Extreme:
    name = f"{'viscous ' if more else ''}suture of {density:g} kg/m^3, sudden"
    what = f"1 N at once at the middle{', damping.stiffness 1 ms' if more else ''}; 2 s"
    values = suture(density, "constant") | more
    return Extreme(name, what, values, 2.0, swings_about_string, 1e-6)


WIRES = (
    _wire("aluminium wire", "2 m, 2 mm, released, n_u 13, 2 ms, 10 s", wire(ALUMINIUM), 1e-8),
    _wire("steel wire", "the same of steel, 200 GPa", wire(STEEL), 1e-8),
    _wire("aluminium wire, automatic", "method and step chosen", wire(ALUMINIUM) | AUTO, 1e-8),
    _wire("n_u = 4", "one span", wire(ALUMINIUM) | {"discretization.control_points": 4}, 1e-7),
    *(_stepped(tau) for tau in HARD_STEPS),
)

SUTURES = (
    *(_pulled(density, {}) for density in (LIGHT, HEAVY)),
    _pulled(HEAVY, AUTO),
    *(_sudden(density, {}) for density in (LIGHT, HEAVY)),
    *(_sudden(density, {"damping.stiffness": 1e-3}) for density in (LIGHT, HEAVY)),
    Extreme(
        "suture at rest",
        "its equilibrium under the pull of 1 N",
        *(suture(HEAVY, "constant") | AT_REST, 0.0, pulls_as_string, 5e-3),
    ),
)

# Name -> scene, duration [s], check and bound. WHAT describes them, EVENTS has (time [s], action).
OTHERS: dict[str, tuple[Values, float, Check, float]] = {
    "glass fibre": (FIBRE, 1.0, sags_as_cantilever, 1e-3),
    "rubber hose": (HOSE, 10.0, weighs_its_weight, 1e-4),
    "rubber hose, automatic": (HOSE | AUTO, 10.0, weighs_its_weight, 1e-4),
    "overhead line": (LINE, 1.0, hangs_as_catenary, 1e-5),
    "n_u = 2000": (LINE | FINE, 0.04, hangs_as_catenary, 1e-5),
    "cable of 1 mm": (pinned_line(1e-3, 1e-5, 1200.0, 1e6, 13), 0.1, lasting, 1e-5),
    "cable of 1 km": (LONG, 10.0, hangs_as_catenary, 1e-4),
    "slack cable snapped taut": (SLACK, 4.0, is_taut, 1e-3),
    "pulse of 1e6 N for 1 ms": (thrown(NYLON, 1e-4, "pull"), 0.01, carries_impulse, 1e-9),
    "free flight": (thrown(SOFT, 1e-3, "left", "right"), 5.0, keeps_momentum, 1e-9),
    "ends that meet": (GRIPPED | ends(-0.45, 0.45) | damped(), 1.5, mirrors, 1e-6),
    "pose jump of 1 m in one tick": (GRIPPED | ends(0.0, 0.8), 1.0, energy_balance, 1e-5),
    "stiffness times 1e6 at run time": (SWINGING, 0.3, energy_balance, 1e-6),
    "straight under twist": (TWISTED, 5.0, turns_as_rod, 1e-6),
    "straight under compression": (column(0.4, 0.0) | STRAIGHT, 0.1, stays_straight, 1e-7),
    "column below its buckling load": (column(0.9), 0.0, amplifies_as_column, 1e-3),
    "column above its buckling load": (column(1.1), 0.0, buckles_as_elastica, 1e-3),
    "ring": (RING, 0.1, closes_ring, 1e-4),
    "catenary settled by damping": (SETTLING, 10.0, rests_as_undamped, 1e-6),
    "catenary at rest, large damping": (VISCOUS, 1.0, rests_as_undamped, 1e-6),
}
WHAT = {
    "glass fibre": "125 um, 5 cm, 72 GPa, clamped at one end, at rest under its weight, 1 s",
    "rubber hose": "2 m, 5 cm thick, 5 MPa, clamped at one end, falls from level, damped; 10 s",
    "rubber hose, automatic": "method and step chosen",
    "overhead line": "100 m, 2 cm, 70 GPa, stranded, n_u 400, at rest, 1 s",
    "n_u = 2000": "the overhead line at rest, and 20 steps",
    "cable of 1 mm": "10 um thick, 1 MPa: at rest, 0.1 s",
    "cable of 1 km": "3 cm thick steel, n_u 100, at rest, 10 s",
    "slack cable snapped taut": "nylon, ends 0.9 L apart, pulled to 1.01 L at 2 m/s, then held, "
    "damped; 4 s",
    "pulse of 1e6 N for 1 ms": "on the middle of a free nylon cable of 3.6 g; 10 ms",
    "free flight": "thrown by two pulses of 10 ms, then 5 s without gravity",
    "ends that meet": "both ends move together in 0.5 s until they are at one place, damped; 1.5 s",
    "pose jump of 1 m in one tick": "the end of a 1 m cable from 0.8 m to -0.2 m beside the start, "
    "at once, undamped; 1 s",
    "stiffness times 1e6 at run time": "a swinging cable of 1 MPa becomes one of 1 TPa for 0.2 s "
    "and soft again; 0.7 s",
    "straight under twist": f"clamped at both ends, the end turned by {TURN:g} rad, 5 s",
    "straight under compression": "pinned column pressed at once with 0.4 Euler loads and nothing "
    "to the side, 0.1 s",
    "column below its buckling load": "0.9 Euler loads and a tiny load to the side",
    "column above its buckling load": "1.1 Euler loads: the shape that it buckles to",
    "ring": "natural curvature 2 pi / L, one end clamped, at rest, 0.1 s",
    "catenary settled by damping": "released straight between ends 0.9 L apart with damping.mass "
    "20 1/s; 10 s",
    "catenary at rest, large damping": "the equilibrium that damping.mass 1e4 1/s and stiffness "
    "1 s start from, after 1 s",
}
EVENTS: dict[str, tuple[tuple[float, Action], ...]] = {
    "slack cable snapped taut": ((0.0, move("end", 2.0, 0.055)),),
    "pulse of 1e6 N for 1 ms": (
        (0.0, push("pull", 0.0, 0.0, BIG_PULSE[0])),
        (BIG_PULSE[1], push("pull", 0.0, 0.0, 0.0)),
    ),
    "free flight": (
        *((0.0, push(name, *force)) for name, force in PULSES.items()),
        *((PULSE, push(name, 0.0, 0.0, 0.0)) for name in PULSES),
    ),
    "ends that meet": ((0.0, move("start", 0.9, 0.5)), (0.0, move("end", -0.9, 0.5))),
    "pose jump of 1 m in one tick": ((0.1, jump("end", -1.0, 0.0, 0.0)),),
    "stiffness times 1e6 at run time": tuple(
        (0.2, reconfigure("cable.youngs_modulus", modulus)) for modulus in (1e12, 1e6)
    ),
    "straight under twist": ((0.0, turn("end", TURN)),),
}
EXTREMES = (
    *(*WIRES, *SUTURES),
    *(Extreme(name, WHAT[name], *row, EVENTS.get(name, ())) for name, row in OTHERS.items()),
)
