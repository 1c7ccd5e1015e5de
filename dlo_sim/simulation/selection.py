"""Which method and step a scene is computed with, and why: the one place that decides it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from dlo_sim.core.methods import IMPLICIT, METHODS, Method
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.terms import restrictions_of

SAFETY = 0.9  # of the linear stability limit, for steps chosen automatically
CLAMPED_SHARE = 0.75  # of explicit steps beside a clamp, whose span stretches and shortens most
WORTH_COMPOSING = 0.8  # of the sub-steps of energy_momentum, from which fourth order is chosen
FAR_LESS = 0.5  # of the work, from which another method is worth a word
# Force evaluations that take as long as an implicit sub-step. Measured with energy_momentum against
# velocity_verlet at 9 and 41 control points on one core: 13 and 14 for the swinging paper_wire (5
# iterations per step), 3 to 5 for two_grippers and hanging_cable at rest (1 iteration).
IMPLICIT_EVALUATIONS = 14
HORIZON = 1.0  # [s] over which a chosen step keeps the accuracy asked for
LEAST_LOADED_STEP = 1e-3  # [s]
LEAST_ACCELERATION = 1.0  # [m/s^2] for scenes in which nothing but the grippers acts


@dataclass(frozen=True)
class Choice:
    """Method and step of a run, and one line that says why.

    limit: largest stable step [s] of the linearised scene, inf for an implicit method; frequency:
    its largest frequency [rad/s], as given to `choose`. resolution: how many control points it has,
    and why, one line.
    """

    method: Method
    step: float
    reason: str
    limit: float
    frequency: float
    resolution: str = ""


def choose(scene: Scene, frequency: float, unchecked_step: bool = False) -> Choice:
    """Method and step of a scene.

    `frequency` is the largest one [rad/s] of the linearised scene; an implicit method needs none.
    `unchecked_step` takes integrator.step as it is, even beyond the stability limit.

    Raises:
        SceneError: unknown method, a method that is not valid with the scene's damping, or a step
            beyond the method's stability limit.
    """
    method, reason = method_of(scene)
    step = scene.integrator.step
    limit = _step_limit(scene, method, frequency)
    if step == 0.0:
        step, why = _chosen_step(scene, method, limit)
        reason += f"; {why}"
    elif step > limit and not unchecked_step:
        raise SceneError(
            f"integrator.step: {step:g} s exceeds the stability limit {limit:.4g} s of "
            f"{method.name} (largest frequency {frequency:.4g} rad/s); lower it, set it to 0, or "
            "use energy_momentum"
        )
    return Choice(method, float(step), reason, float(limit), frequency)


def less_work(scene: Scene, taken: Choice) -> Choice | None:
    """What would be chosen for a scene that left method and step open, if that is far less work.

    None, too, where the frequency is not known on which that depends.
    """
    try:
        free = scene.with_values({"integrator.method": "auto", "integrator.step": 0.0})
        if not taken.frequency and method_of(free)[0].family != IMPLICIT:
            return None
        other = choose(free, taken.frequency)
    except SceneError:
        return None
    return other if _work(other) < FAR_LESS * _work(taken) else None


def _work(choice: Choice) -> float:
    """Force evaluations per simulated second [1/s], about."""
    method = choice.method
    each = method.force_evaluations or IMPLICIT_EVALUATIONS * len(method.substeps)
    return each / choice.step


def _chosen_step(scene: Scene, method: Method, limit: float) -> tuple[float, str]:
    """A step for a scene that names none, in whole nanoseconds, and the reason.

    Message stamps have no finer unit than a nanosecond, so step times are exact in both.
    """
    step, why = accurate_step(scene, method)
    stable = SAFETY * limit
    if stable < step:
        step, why = stable, f"{SAFETY:g} of the stability limit {limit:.3g} s"
    clamped = any(end.clamped for end in scene.ends.values())
    if clamped and method.family != IMPLICIT:
        step, why = CLAMPED_SHARE * step, f"{CLAMPED_SHARE:g} for the clamp; {why}"
    period = 1.0 / scene.rate
    if step >= period:
        step, why = period, f"one period of rate {scene.rate:g} Hz"
    elif method.family == IMPLICIT:
        step = period / np.ceil(period / step)  # ticks end on steps
    step = max(np.floor(step * 1e9 + 1e-3), 1.0) * 1e-9
    return float(step), f"step {step:.4g} s: {why}"


def accurate_step(scene: Scene, method: Method = METHODS["energy_momentum"]) -> tuple[float, str]:
    """Step of a method that keeps the motion within accuracy.target over a second.

    Under an acceleration a, a mode of frequency w moves by a / w^2 and its phase errs by
    k w T (w tau)^p after a time T with a method of order p (k = 1/12 for p = 2), so it is off by
    k a T / w (w tau)^p. Faster modes err more, to w = sqrt(a / target): beyond it they move by less
    than the target anyway. One mode is looked at: a stiff wire let go at once, all of whose modes
    err together, was seen to miss the target by a factor of 2.6. Forces that would shoot a light
    cable away, such as newtons on a suture, meet its stiffness instead: for them no step is chosen
    below `LEAST_LOADED_STEP`.
    """
    target = scene.accuracy.target
    mass = scene.cable.mu * scene.cable.length + scene.start.mass + scene.end.mass
    pull = sum(math.hypot(*load.force) for load in scene.loads)
    calm = max(math.hypot(*scene.gravity), LEAST_ACCELERATION)
    step, fastest = _following(calm + pull / mass, target, method)
    why = f"modes up to {fastest:.3g} rad/s stay within accuracy.target {target:g} m for 1 s"
    least = min(_following(calm, target, method)[0], LEAST_LOADED_STEP)
    if step < least:
        step = least
        why = f"what the loads set vibrating beyond {1.0 / step:.3g} rad/s is stepped over"
    sines = [load.frequency for load in scene.loads if load.signal == "sine"]
    if sines and step > 0.05 / max(sines):
        step, why = 0.05 / max(sines), f"twenty steps a period of the {max(sines):g} Hz load"
    return float(step), why


def _following(acceleration: float, target: float, method: Method) -> tuple[float, float]:
    """Step [s] and fastest mode [rad/s] that matter under an acceleration [m/s^2]."""
    fastest = np.sqrt(acceleration / target)
    phase = (method.phase_error * fastest * HORIZON) ** (-1.0 / method.order)
    return float(phase / fastest), float(fastest)


def method_of(scene: Scene) -> tuple[Method, str]:
    """The method of a scene, and why.

    Raises:
        SceneError: unknown, or not valid with the scene.
    """
    name, reason = scene.integrator.method, "as the scene asks"
    if name == "auto":
        name, reason = _automatic(scene)
    if name == "generalized_alpha":
        raise SceneError(
            f"integrator.method: '{name}' is no longer available; use energy_momentum, which "
            "conserves the energy at any step"
        )
    if name not in METHODS:
        raise SceneError(
            f"integrator.method: '{name}' is not a method; use one of {', '.join(METHODS)} or auto"
        )
    asked = restrictions_of(scene)
    fitting = [one for one in METHODS if all(one in each.methods for each in asked)]
    if not fitting:
        pairs = combinations(asked, 2)
        one, other = next((a, b) for a, b in pairs if not set(a.methods) & set(b.methods))
        raise SceneError(
            f"{one.asked(scene)} needs {one.kind}, {other.asked(scene)} {other.kind}; set "
            f"{one.key} to {one.off}, or {other.key} to {other.off}"
        )
    for one in asked:
        if name not in one.methods:
            best = next(each for each in one.methods if each in fitting)
            cure = f"use {best}, or set {one.key} to {one.off}"
            raise SceneError(
                f"integrator.method: {name} is not valid with {one.asked(scene)}{one.why}; {cure}"
            )
    return METHODS[name], reason


def _step_limit(scene: Scene, method: Method, frequency: float) -> float:
    """Largest stable step [s] of the linearised scene, whose modes are all damped at its rates."""
    frequency += method.decay_weight * max(scene.decay_rates)
    return method.stability_limit / frequency if frequency > 0.0 else np.inf


def _automatic(scene: Scene) -> tuple[str, str]:
    """An implicit method, whose steps are stable and keep the energy however far the cable moves.

    The stability limit of explicit steps is that of the cable at rest. Where it swings freely, its
    spans are compressed, their bending becomes stiffer, and even steps of 0.15 times that limit
    gain energy: of 26 soft cables that swung for 10 s, 16 diverged at 0.9 times the limit.
    """
    asked = restrictions_of(scene)
    second, fourth = METHODS["energy_momentum"], METHODS["energy_momentum_4"]
    for one in asked:
        if second.name not in one.methods:
            return "velocity_verlet", f"{one.asked(scene)} needs {one.kind}"
    composable = all(fourth.name in one.methods for one in asked)
    if composable and _cost(scene, fourth) < WORTH_COMPOSING * _cost(scene, second):
        return fourth.name, f"accuracy.target {scene.accuracy.target:g} m wants order 4"
    return second.name, "implicit: any step is stable"


def _cost(scene: Scene, method: Method) -> float:
    """Sub-steps per second [1/s] of an implicit method at the step that would be chosen for it."""
    step = scene.integrator.step or _chosen_step(scene, method, np.inf)[0]
    return len(method.substeps) / step
