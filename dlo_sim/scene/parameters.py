"""The one table of parameters.

Everything that needs to know a parameter reads it here: the loader (kind, range, choices), the node
(declaration and descriptors), the README (its table is printed from this one). Adding a parameter
means one row here and one field in `description.py`; a test compares the two.
"""

from dlo_sim.scene.cable_parameters import (
    CABLE,
    DAMPING,
    DISCRETIZATION,
    GENERAL,
    GRAVITY,
    PLASTICITY,
    TERMS,
    TORSION,
)
from dlo_sim.scene.parameter import SWITCH, Parameter, allowed, choice, number, shown, text, vector


def _end_parameters(
    end: str, position: tuple[float, float, float], held: bool
) -> tuple[Parameter, ...]:
    """The block of one end, `start` (u = 0) or `end` (u = L)."""
    return (
        vector(
            f"{end}.position",
            position,
            "m",
            1.0e6,
            "End-effector position before any pose is received; for a free end only the direction "
            "of the initial straight line.",
        ),
        Parameter(
            f"{end}.fixed",
            "bool_array",
            (held, held, held),
            length=3,
            description="Per world axis: held at the position of the end-effector.",
        ),
        vector(
            f"{end}.spring",
            (0.0, 0.0, 0.0),
            "N/m",
            1.0e12,
            "Per world axis that is not fixed: spring to the position of the end-effector.",
            low=0.0,
        ),
        Parameter(
            f"{end}.clamped",
            "bool",
            False,
            description="Tangent and twist held by the end-effector; needs all three axes fixed.",
        ),
        vector(
            f"{end}.tangent",
            (0.0, 0.0, 0.0),
            "",
            1.0e6,
            "Direction of the cable (from start towards end) at this end, in the end-effector's "
            "frame; zeros = from start.position to end.position.",
        ),
        vector(
            f"{end}.offset",
            (0.0, 0.0, 0.0),
            "m",
            1.0e3,
            "Point where the cable is attached, in the end-effector's frame.",
        ),
        text(
            f"{end}.frame",
            "",
            "Name of the end-effector's frame; wrenches stamped with it are rotated to the world.",
        ),
        number(f"{end}.mass", 0.0, "kg", 0.0, 1.0e4, "Point mass at this end."),
        text(
            f"{end}.pose_topic",
            "",
            "Topic (PoseStamped) of the end-effector that moves this end; empty = it stands still.",
            True,
        ),
        number(
            f"{end}.pose_timeout",
            1.0,
            "s",
            0.01,
            3600.0,
            "Silence after which the last pose is held and a warning given.",
        ),
        number(
            f"{end}.pose_smoothing",
            0.0,
            "s",
            0.0,
            1.0,
            "Half the window over which poses are smoothed by parabolas, for noisy tracking; the "
            "prediction waits for it (raise inputs.latency by as much), 0 = off.",
        ),
    )


_REST = (
    choice(
        "initial.shape",
        "auto",
        ("auto", "straight", "equilibrium"),
        "Shape at the start and after a reset; auto = straight when an end is free or the held "
        "ends are one length apart, else equilibrium.",
    ),
    text("integrator.method", "auto", "Time integration method; see `dlo_sim methods`."),
    number(
        "integrator.step",
        0.0,
        "s",
        0.0,
        1.0,
        "Time step tau, at least 1e-9; 0 = chosen from the scene and the accuracy asked for.",
    ),
    number(
        "integrator.spectral_radius",
        0.8,
        "",
        0.0,
        1.0,
        "Spectral radius of generalized_alpha at infinite frequency: 1 keeps all, 0 kills it in a "
        "step.",
    ),
    number(
        "integrator.zhai_psi",
        0.5,
        "",
        0.0,
        1.0,
        "Parameter psi of Zhai's method; the pair 0.5, 0.5 has the largest stable step.",
    ),
    number(
        "integrator.zhai_phi",
        0.5,
        "",
        0.0,
        1.0,
        "Parameter phi of Zhai's method; second order only with 0.5.",
    ),
    number(
        "integrator.tolerance",
        1.0e-10,
        "",
        1.0e-15,
        1.0e-2,
        "Relative tolerance of the equations that implicit methods solve.",
    ),
    choice(
        "integrator.on_failure",
        "hold",
        ("hold", "stop"),
        "When a step fails: hold the last good state until ~/reset, or stop the node.",
    ),
    number(
        "inputs.latency",
        0.06,
        "s",
        0.0,
        10.0,
        "The prediction runs this far behind, so that poses are interpolated, not guessed.",
    ),
    choice(
        "inputs.time",
        "auto",
        ("auto", "stamp", "arrival"),
        "When an input counts: its header stamp, its arrival, or the stamp shifted to the clock.",
    ),
    number("inputs.max_speed", 20.0, "m/s", 1.0e-3, 1.0e6, "Poses that move faster are refused."),
    number("inputs.max_force", 1.0e4, "N", 1.0e-6, 1.0e9, "Larger forces are refused."),
    number("inputs.max_torque", 1.0e3, "N m", 1.0e-6, 1.0e9, "Larger torques are refused."),
    number(
        "inputs.catch_up",
        0.1,
        "s",
        1.0e-3,
        10.0,
        "Most simulated time per timer tick; at least one timer period.",
    ),
    Parameter(
        "outputs.centerline_samples",
        "integer",
        50,
        "",
        2,
        10_000,
        (),
        None,
        "Points of the centerline in markers and recordings.",
    ),
    number("outputs.marker_rate", 30.0, "Hz", 0.1, 1000.0, "Rate of the markers."),
    number(
        "accuracy.target",
        0.001,
        "m",
        1.0e-9,
        1.0e3,
        "Position error that is acceptable; a larger estimate is a warning.",
    ),
    choice(
        "accuracy.estimate",
        "auto",
        SWITCH,
        "Run two finer companions and report how far they are away; auto = in the node, until it "
        "cannot keep up.",
    ),
)

PARAMETERS: tuple[Parameter, ...] = (
    *GENERAL,
    *CABLE,
    *DAMPING,
    *DISCRETIZATION,
    *TERMS,
    *PLASTICITY,
    *TORSION,
    *GRAVITY,
    *_end_parameters("start", (0.0, 0.0, 0.0), held=True),
    *_end_parameters("end", (1.0, 0.0, 0.0), held=False),
    Parameter(
        "loads.names",
        "string_array",
        (),
        description="Names of the loads; each has a block `loads.<name>`.",
        read_only=True,
    ),
    *_REST,
)
"""Every parameter but those of the loads, which depend on `loads.names`."""


def load_parameters(name: str) -> tuple[Parameter, ...]:
    """The parameters of the load `name`: the block `loads.<name>.*`."""
    key = f"loads.{name}"
    return (
        text(
            f"{key}.topic",
            "",
            "Topic of the load; empty and no signal = `~/<name>/wrench` or `~/<name>/force` "
            "(a force load named `force`: `~/force`).",
            True,
        ),
        choice(
            f"{key}.type",
            "wrench",
            ("wrench", "force"),
            "Message type: WrenchStamped, or Vector3Stamped (a force).",
            True,
        ),
        number(
            f"{key}.position",
            0.0 if name == "start" else 1.0,
            "",
            0.0,
            1.0,
            "Where on the cable: 0 at start, 1 at end; a load named `start` has default 0.0.",
        ),
        number(
            f"{key}.timeout",
            0.5,
            "s",
            0.0,
            3600.0,
            "Silence after which the load is removed; 0 = never.",
        ),
        number(
            f"{key}.sign",
            1.0,
            "",
            -1.0,
            1.0,
            "1: messages give the load on the cable by the end-effector; -1: the opposite.",
            (1.0, -1.0),
        ),
        choice(
            f"{key}.signal",
            "none",
            ("none", "constant", "sine"),
            "Load without a topic: constant, or force times sin(2 pi frequency t).",
            True,
        ),
        vector(f"{key}.force", (0.0, 0.0, 0.0), "N", 1.0e9, "Force of the signal, world frame."),
        vector(
            f"{key}.torque", (0.0, 0.0, 0.0), "N m", 1.0e9, "Torque of the signal, world frame."
        ),
        number(f"{key}.frequency", 1.0, "Hz", 1.0e-6, 1.0e4, "Frequency of a sine."),
    )


def scene_parameters(load_names: tuple[str, ...] = ()) -> tuple[Parameter, ...]:
    """The whole table of a scene with these loads, in the order of the README."""
    loads = tuple(row for name in load_names for row in load_parameters(name))
    return PARAMETERS + loads


def markdown_table() -> str:
    """The parameter table as GitHub markdown, without a trailing newline."""
    lines = [
        "| parameter | type | default | unit | range | meaning |",
        "|---|---|---|---|---|---|",
    ]
    lines += [_markdown_row(row) for row in scene_parameters(("<name>",))]
    return "\n".join(lines)


def _markdown_row(row: Parameter) -> str:
    kind = row.kind.replace("_array", "[]")
    if row.length is not None:
        kind = kind.replace("[]", f"[{row.length}]")
    meaning = row.description + (" *Read-only.*" if row.read_only else "")
    cells = (f"`{row.key}`", kind, f"`{shown(row.default)}`", row.unit, allowed(row), meaning)
    return "| " + " | ".join(cells) + " |"
