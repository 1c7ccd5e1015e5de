"""The one table of parameters.

Everything that needs to know a parameter reads it here: the loader (kind, range, choices), the node
(declaration and descriptors), the README (its table is printed from this one). Adding a parameter
means one row here and one field in `description.py`; a test compares the two.
"""

from dlo_sim.scene.parameter import Parameter, allowed, shown


def _number(
    key: str,
    default: float,
    unit: str,
    low: float,
    high: float,
    description: str,
    choices: tuple[float, ...] = (),
) -> Parameter:
    return Parameter(key, "double", default, unit, low, high, choices, None, description)


def _vector(
    key: str,
    default: tuple[float, float, float],
    unit: str,
    bound: float,
    description: str,
    low: float | None = None,
) -> Parameter:
    lowest = -bound if low is None else low
    return Parameter(key, "double_array", default, unit, lowest, bound, (), 3, description)


def _choice(
    key: str, default: str, choices: tuple[str, ...], description: str, read_only: bool = False
) -> Parameter:
    return Parameter(key, "string", default, "", None, None, choices, None, description, read_only)


def _text(key: str, default: str, description: str, read_only: bool = False) -> Parameter:
    return Parameter(key, "string", default, "", None, None, (), None, description, read_only)


_SWITCH = ("auto", "on", "off")

_GENERAL = (
    _text("frame_id", "world", "World frame of all outputs and of inputs without a frame.", True),
    _number("rate", 200.0, "Hz", 1.0, 2000.0, "Rate of the node's timer."),
)

_CABLE = (
    _number("cable.length", 1.0, "m", 1.0e-4, 1.0e4, "Rest length L."),
    _number("cable.diameter", 0.005, "m", 1.0e-6, 1.0, "Diameter D of the round section."),
    _number("cable.density", 1200.0, "kg/m^3", 1.0e-2, 1.0e5, "Density rho."),
    _number("cable.youngs_modulus", 1.0e7, "Pa", 1.0, 1.0e13, "Young's modulus E."),
    _number("cable.shear_modulus", 3.5e6, "Pa", 1.0, 1.0e13, "Shear modulus G."),
    _number(
        "cable.linear_density",
        0.0,
        "kg/m",
        0.0,
        1.0e4,
        "Mass per length mu; 0 = rho pi D^2 / 4.",
    ),
    _number("cable.axial_stiffness", 0.0, "N", 0.0, 1.0e14, "EA; 0 = E pi D^2 / 4."),
    _number("cable.bending_stiffness", 0.0, "N m^2", 0.0, 1.0e12, "EI; 0 = E pi D^4 / 64."),
    _number("cable.torsional_stiffness", 0.0, "N m^2", 0.0, 1.0e12, "GJ; 0 = G pi D^4 / 32."),
    Parameter(
        "cable.rest_curvature",
        "double_array",
        (0.0,),
        "1/m",
        -1.0e5,
        1.0e5,
        (),
        None,
        "Natural curvature at equally spaced points from start to end, linear between them; "
        "one value = the same everywhere.",
    ),
    _vector(
        "cable.rest_curvature_axis",
        (0.0, 1.0, 0.0),
        "",
        1.0,
        "Unit axis about which the unloaded cable is bent, in the start end-effector's frame; "
        "positive curvature turns the tangent about it by the right-hand rule.",
    ),
)

_DAMPING = (
    _number(
        "damping.mass", 0.0, "1/s", 0.0, 1.0e6, "Rayleigh alpha: force -alpha M v on the cable."
    ),
    _number("damping.stiffness", 0.0, "s", 0.0, 1.0e3, "Rayleigh beta: internal damping beta K."),
    _number(
        "damping.air_drag",
        0.0,
        "N s/m^2",
        0.0,
        1.0e6,
        "Linear drag: force per length of cable and per speed.",
    ),
)

_DISCRETIZATION = (
    Parameter(
        "discretization.control_points",
        "integer",
        13,
        "",
        4,
        2000,
        (),
        None,
        "Number of control points n_u of the cubic B-spline.",
    ),
    _choice(
        "discretization.quadrature",
        "gauss",
        ("gauss", "uniform"),
        "Where integrals along the cable are sampled: Gauss points per knot span, or uniformly.",
    ),
    Parameter(
        "discretization.samples",
        "integer",
        3,
        "",
        1,
        100_000,
        (),
        None,
        "Quadrature points: per knot span for gauss (2 to 10), in all for uniform (2 a span).",
    ),
    _choice(
        "discretization.mass",
        "consistent",
        ("consistent", "lumped"),
        "Mass matrix: consistent (banded) or lumped (diagonal, less accurate).",
    ),
)

_TERMS = (
    _choice("terms.stretch", "auto", _SWITCH, "Axial stretching energy."),
    _choice("terms.bend", "auto", _SWITCH, "Bending energy."),
    _choice(
        "terms.twist",
        "auto",
        ("auto", "on", "off", "frenet", "quasistatic"),
        "Torsion energy and the twist angle.",
    ),
    _choice("terms.gravity", "auto", _SWITCH, "Weight."),
    _choice("terms.damping", "auto", _SWITCH, "All damping."),
    _choice("terms.plasticity", "auto", _SWITCH, "Plastic bending."),
    _choice("terms.contact", "auto", _SWITCH, "Contact."),
    _choice(
        "terms.out_of_plane",
        "auto",
        _SWITCH,
        "The third coordinate. Auto leaves it out where everything stays in a coordinate plane.",
    ),
)

_PLASTICITY = (
    _number(
        "plasticity.yield_curvature",
        0.0,
        "1/m",
        0.0,
        1.0e5,
        "Curvature beyond which bending leaves a set; 0 = it never does.",
    ),
    _number(
        "plasticity.hardening",
        0.0,
        "",
        0.0,
        0.999,
        "Tangent over elastic bending stiffness beyond yield (linear kinematic hardening).",
    ),
)

_TORSION = (
    _number(
        "torsion.curvature_floor",
        0.0,
        "1/m",
        0.0,
        1.0e5,
        "For terms.twist frenet: curvature below which torsion counts as undefined and is "
        "suppressed; 0 = 1 % of the curvature of the ring that the cable can be bent to.",
    ),
)

_GRAVITY = (
    _vector("gravity", (0.0, 0.0, -9.81), "m/s^2", 1.0e4, "Acceleration of gravity, world frame."),
)


def _end_parameters(
    end: str, position: tuple[float, float, float], held: bool
) -> tuple[Parameter, ...]:
    """The block of one end, `start` (u = 0) or `end` (u = L)."""
    return (
        _vector(
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
        _vector(
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
        _vector(
            f"{end}.tangent",
            (0.0, 0.0, 0.0),
            "",
            1.0e6,
            "Direction of the cable (from start towards end) at this end, in the end-effector's "
            "frame; zeros = from start.position to end.position.",
        ),
        _vector(
            f"{end}.offset",
            (0.0, 0.0, 0.0),
            "m",
            1.0e3,
            "Point where the cable is attached, in the end-effector's frame.",
        ),
        _text(
            f"{end}.frame",
            "",
            "Name of the end-effector's frame; wrenches stamped with it are rotated to the world.",
        ),
        _number(f"{end}.mass", 0.0, "kg", 0.0, 1.0e4, "Point mass at this end."),
        _text(
            f"{end}.pose_topic",
            "",
            "Topic (PoseStamped) of the end-effector that moves this end; empty = it stands still.",
            True,
        ),
        _number(
            f"{end}.pose_timeout",
            1.0,
            "s",
            0.01,
            3600.0,
            "Silence after which the last pose is held and a warning given.",
        ),
        _number(
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
    _choice(
        "initial.shape",
        "auto",
        ("auto", "straight", "equilibrium"),
        "Shape at the start and after a reset; auto = straight when an end is free or the held "
        "ends are one length apart, else equilibrium.",
    ),
    _text("integrator.method", "auto", "Time integration method; see `dlo_sim methods`."),
    _number(
        "integrator.step",
        0.0,
        "s",
        0.0,
        1.0,
        "Time step tau; 0 = chosen from the scene and the accuracy asked for.",
    ),
    _number(
        "integrator.spectral_radius",
        0.8,
        "",
        0.0,
        1.0,
        "Spectral radius of generalized_alpha at infinite frequency: 1 keeps all, 0 kills it in a "
        "step.",
    ),
    _number(
        "integrator.zhai_psi",
        0.5,
        "",
        0.0,
        1.0,
        "Parameter psi of Zhai's method; the pair 0.5, 0.5 has the largest stable step.",
    ),
    _number(
        "integrator.zhai_phi",
        0.5,
        "",
        0.0,
        1.0,
        "Parameter phi of Zhai's method; second order only with 0.5.",
    ),
    _number(
        "integrator.tolerance",
        1.0e-10,
        "",
        1.0e-15,
        1.0e-2,
        "Relative tolerance of the equations that implicit methods solve.",
    ),
    _choice(
        "integrator.on_failure",
        "hold",
        ("hold", "stop"),
        "When a step fails: hold the last good state until ~/reset, or stop the node.",
    ),
    _number(
        "inputs.latency",
        0.06,
        "s",
        0.0,
        10.0,
        "The prediction runs this far behind, so that poses are interpolated, not guessed.",
    ),
    _choice(
        "inputs.time",
        "auto",
        ("auto", "stamp", "arrival"),
        "When an input counts: its header stamp, its arrival, or the stamp shifted to the clock.",
    ),
    _number("inputs.max_speed", 20.0, "m/s", 1.0e-3, 1.0e6, "Poses that move faster are refused."),
    _number("inputs.max_force", 1.0e4, "N", 1.0e-6, 1.0e9, "Larger forces are refused."),
    _number("inputs.max_torque", 1.0e3, "N m", 1.0e-6, 1.0e9, "Larger torques are refused."),
    _number(
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
    _number("outputs.marker_rate", 30.0, "Hz", 0.1, 1000.0, "Rate of the markers."),
    _number(
        "accuracy.target",
        0.001,
        "m",
        1.0e-9,
        1.0e3,
        "Position error that is acceptable; a larger estimate is a warning.",
    ),
    _choice(
        "accuracy.estimate",
        "auto",
        _SWITCH,
        "Run two finer companions and report how far they are away; auto = in the node, until it "
        "cannot keep up.",
    ),
)

PARAMETERS: tuple[Parameter, ...] = (
    *_GENERAL,
    *_CABLE,
    *_DAMPING,
    *_DISCRETIZATION,
    *_TERMS,
    *_PLASTICITY,
    *_TORSION,
    *_GRAVITY,
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
        _text(
            f"{key}.topic",
            "",
            "Topic of the load; empty and no signal = `~/<name>/wrench` or `~/<name>/force` "
            "(a force load named `force`: `~/force`).",
            True,
        ),
        _choice(
            f"{key}.type",
            "wrench",
            ("wrench", "force"),
            "Message type: WrenchStamped, or Vector3Stamped (a force).",
            True,
        ),
        _number(
            f"{key}.position",
            0.0 if name == "start" else 1.0,
            "",
            0.0,
            1.0,
            "Where on the cable: 0 at start, 1 at end; a load named `start` has default 0.0.",
        ),
        _number(
            f"{key}.timeout",
            0.5,
            "s",
            0.0,
            3600.0,
            "Silence after which the load is removed; 0 = never.",
        ),
        _number(
            f"{key}.sign",
            1.0,
            "",
            -1.0,
            1.0,
            "1: messages give the load on the cable by the end-effector; -1: the opposite.",
            (1.0, -1.0),
        ),
        _choice(
            f"{key}.signal",
            "none",
            ("none", "constant", "sine"),
            "Load without a topic: constant, or force times sin(2 pi frequency t).",
            True,
        ),
        _vector(f"{key}.force", (0.0, 0.0, 0.0), "N", 1.0e9, "Force of the signal, world frame."),
        _vector(
            f"{key}.torque", (0.0, 0.0, 0.0), "N m", 1.0e9, "Torque of the signal, world frame."
        ),
        _number(f"{key}.frequency", 1.0, "Hz", 1.0e-6, 1.0e4, "Frequency of a sine."),
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
