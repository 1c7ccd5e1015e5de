"""Rows of the parameter table: the cable itself, and how it is discretised."""

from dlo_sim.scene.parameter import SWITCH, Parameter, choice, number, text, vector

GENERAL = (
    text("frame_id", "world", "World frame of all outputs and of inputs without a frame.", True),
    number("rate", 200.0, "Hz", 1.0, 2000.0, "Rate of the node's timer."),
)

CABLE = (
    number("cable.length", 1.0, "m", 1.0e-4, 1.0e4, "Rest length L."),
    number("cable.diameter", 0.005, "m", 1.0e-6, 1.0, "Diameter D of the round section."),
    number("cable.density", 1200.0, "kg/m^3", 1.0e-2, 1.0e5, "Density rho."),
    number("cable.youngs_modulus", 1.0e7, "Pa", 1.0, 1.0e13, "Young's modulus E."),
    number("cable.shear_modulus", 3.5e6, "Pa", 1.0, 1.0e13, "Shear modulus G."),
    number(
        "cable.linear_density",
        0.0,
        "kg/m",
        0.0,
        1.0e4,
        "Mass per length mu; 0 = rho pi D^2 / 4.",
    ),
    number("cable.axial_stiffness", 0.0, "N", 0.0, 1.0e14, "EA; 0 = E pi D^2 / 4."),
    number("cable.bending_stiffness", 0.0, "N m^2", 0.0, 1.0e12, "EI; 0 = E pi D^4 / 64."),
    number("cable.torsional_stiffness", 0.0, "N m^2", 0.0, 1.0e12, "GJ; 0 = G pi D^4 / 32."),
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
    vector(
        "cable.rest_curvature_axis",
        (0.0, 1.0, 0.0),
        "",
        1.0,
        "Unit axis about which the unloaded cable is bent, in the start end-effector's frame; "
        "positive curvature turns the tangent about it by the right-hand rule.",
    ),
)

DAMPING = (
    number(
        "damping.mass", 0.0, "1/s", 0.0, 1.0e6, "Rayleigh alpha: force -alpha M v on the cable."
    ),
    number("damping.stiffness", 0.0, "s", 0.0, 1.0e3, "Rayleigh beta: internal damping beta K."),
    number(
        "damping.air_drag",
        0.0,
        "N s/m^2",
        0.0,
        1.0e6,
        "Linear drag: force per length of cable and per speed.",
    ),
)

DISCRETIZATION = (
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
    choice(
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
    choice(
        "discretization.stretch",
        "sample",
        ("sample", "span"),
        "Where stretching counts: at every sample, or by its mean over a knot span, which lets "
        "thin cables bend freely with few control points (needs gauss and 5 control points).",
    ),
    choice(
        "discretization.mass",
        "consistent",
        ("consistent", "lumped"),
        "Mass matrix: consistent (banded) or lumped (diagonal, less accurate).",
    ),
)

TERMS = (
    choice(
        "terms.stretch",
        "auto",
        SWITCH,
        "Axial stretching energy. Off, with integrator.method auto: rattle keeps the length, where "
        "it can.",
    ),
    choice("terms.bend", "auto", SWITCH, "Bending energy."),
    choice(
        "terms.twist",
        "auto",
        ("auto", "on", "off", "frenet", "quasistatic"),
        "Torsion energy and the twist angle.",
    ),
    choice("terms.gravity", "auto", SWITCH, "Weight."),
    choice("terms.damping", "auto", SWITCH, "All damping."),
    choice("terms.plasticity", "auto", SWITCH, "Plastic bending."),
    choice("terms.contact", "auto", SWITCH, "Contact."),
    choice(
        "terms.out_of_plane",
        "auto",
        SWITCH,
        "The third coordinate. Auto leaves it out where everything stays in a coordinate plane; "
        "off drops forces and moments out of the plane and projects the ends' motion onto it.",
    ),
)

PLASTICITY = (
    number(
        "plasticity.yield_curvature",
        0.0,
        "1/m",
        0.0,
        1.0e5,
        "Curvature beyond which bending leaves a set; 0 = it never does.",
    ),
    number(
        "plasticity.hardening",
        0.0,
        "",
        0.0,
        0.999,
        "Tangent over elastic bending stiffness beyond yield (linear kinematic hardening).",
    ),
)

TORSION = (
    number(
        "torsion.curvature_floor",
        0.0,
        "1/m",
        0.0,
        1.0e5,
        "For terms.twist frenet: curvature below which torsion counts as undefined and is "
        "suppressed; 0 = 1 % of the curvature of the ring that the cable can be bent to.",
    ),
)

GRAVITY = (
    vector("gravity", (0.0, 0.0, -9.81), "m/s^2", 1.0e4, "Acceleration of gravity, world frame."),
)
