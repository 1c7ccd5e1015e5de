"""PyElastica's Cosserat rod.

Its shear stiffness and the rotary inertia of its sections limit steps to 0.1 to 1 us on thin stiff
cables. If that is too slow, a short piece gives the cost of a simulated second, without an error.
"""

import contextlib

import numpy as np

with contextlib.suppress(ModuleNotFoundError):  # this file is also imported without it
    import elastica

PACKAGE = "elastica"
MOST_STEPS = 400_000  # of a complete run


def build(job):
    """A simulator and its rod."""

    class Scene(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing):
        """A system with constraints and forces, composed of PyElastica's mixins."""

    scene = Scene()
    rod = elastica.CosseratRod.straight_rod(
        job["n"],
        np.zeros(3),
        np.array(job["direction"]),
        np.array([0.0, 1.0, 0.0]),
        job["length"],
        0.5 * job["diameter"],
        job["density"],
        youngs_modulus=job["youngs_modulus"],
        shear_modulus=job["shear_modulus"],
    )
    scene.append(rod)
    scene.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=np.array([0, 0, -9.81]))
    if job["kind"] in ("cantilever", "hanging"):
        held = {"constrained_position_idx": (0,)}
        if job["kind"] == "cantilever":
            scene.constrain(rod).using(
                elastica.OneEndFixedBC, constrained_director_idx=(0,), **held
            )
        else:
            scene.constrain(rod).using(elastica.GeneralConstraint, **held)
    scene.finalize()
    return scene, rod


class Cable:
    """A rod in motion; see `serve`."""

    def __init__(self, job):
        self.scene, self.rod = build(job)
        self.stepper = elastica.PositionVerlet()
        self.step = job["step"]
        self.observed = [round(u * job["n"]) for u in job["observed"]]

    def look(self, first, steps):
        """Observed points."""
        return self.rod.position_collection[:, self.observed].T

    def advance(self, first, steps):
        """Steps."""
        now = first * self.step
        for _ in range(steps):
            now = self.stepper.step(self.scene, now, self.step)
