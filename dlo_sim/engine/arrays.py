"""The arrays of a cable, by name; the same in Python and in compiled code (`compiling.groups`).

A *line* holds one coordinate of all control points: two or three of x, y, z (`axes`), then the
twist angle theta where there is twist. Control point i is column MARGIN + i, and zeros on both
sides let whole vectors be loaded there. A *block* is LANES neighbouring knot spans, the lanes of a
vector. A *row* is one scalar equality constraint by which a grasp prescribes the cable, or two
branches stay together (`engine.rows`); border rows, at places between control points, are the last
rigid ones. A *strand* is one spline; the control points of several follow each other, and knot
spans that belong to none are *void*: without length, samples or stiffness, as the lanes beyond the
last span. Band matrices go over all unknowns, control point i and line d at i lines + d; entry
(r, c) is at [r, c - r + 4 lines - 1].
"""

from __future__ import annotations

from dlo_sim.compiling import groups
from dlo_sim.compiling.groups import Group, Lanes, Number, Numbers, Reals, Whole, Wholes, group_at

MARGIN = 3  # columns before the first control point
PADDING = 16  # zeros before and behind a vector of all unknowns
SOME = 32  # columns for which `border.solve_border` solves at a time
MOST_CORRECTIONS = 14  # of one implicit step with one matrix
MOST_STAGES = 4  # of a Runge-Kutta method
ROLL_SIZE = 7  # numbers of `State.roll`
FRAME_SIZE = 8  # numbers of `State.frame`
MOTION_SIZE = 36  # numbers of the motion of a grasp (`engine.grasps`)

# Bits of the active terms.
STRETCH = 1
SPAN_STRETCH = 2  # stretching by span
ANY_STRETCH = STRETCH | SPAN_STRETCH
BEND = 4
CURVED = 8  # natural or plastic curvature
TWISTED = 16
TORSION = 32
PLASTICITY = 64
GRAVITY = 128
DAMPED = 256  # linear damping and stiffness damping
BISHOP = 512  # twist relative to the Bishop frame
CONTACT = 1024
MATERIAL = 2048  # natural curvature, and rest twist, in the material frame
DRAG = 4096  # of water, and of air where it depends on the direction
STATIC_TWIST = 8192  # twist without inertia, in equilibrium at the end of each step
THINNED = 16384  # rate-thinning viscosity of bending
GUARDED = 32768  # spans are kept from turning over (`engine.span_guard`)
BORDERED = 1 << 16  # a place between control points may be held (`engine.border`)
LOADED = 1 << 17  # wrenches may act
SPRUNG = 1 << 18  # springs may hold the cable
ROLLED = 1 << 34  # strands turn with bodies (`engine.roll`)
RIGID = 1 << 22  # rigid bodies (`engine.rigid_body`)
MESHED = 1 << 24  # obstacles may be triangle meshes (`contact.MESH`)
SLIDING = 1 << 25  # grasps may let the cable slide
PRESSURE = 1 << 26  # in the bore of a hose
SELF = 1 << 27  # the cable touches itself (`engine.self_contact`)
SURFACE = 1 << 32  # the water has a surface (`engine.buoyancy`)
ROLLING = 1 << 28  # friction also turns the cable about its axis (`engine.contact`)
BOXED, ROUND, TUBED = 1 << 29, 1 << 30, 1 << 31  # obstacles may be `contact.BOX`, CYLINDER, TUBE

# Of the terms that `scene.terms.TERMS` and `scene.needs` know by a name.
BITS = {
    "bend": BEND,
    "twist": TWISTED,
    "frenet": TORSION,
    "bishop": BISHOP,
    "quasistatic": STATIC_TWIST,
    "plasticity": PLASTICITY,
    "contact": CONTACT,
    "self_contact": SELF,
    "gravity": GRAVITY,
    "loads": LOADED,
    "damping": DAMPED,
    "pressure": PRESSURE,
}

# Bits of the families of methods, beside those of the terms.
SPLITTING, RUNGE_KUTTA, ZHAI = 1 << 19, 1 << 20, 1 << 21
IMPLICIT = 1 << 23
BETWEEN = 1 << 33  # not a family: for equilibrium, and the forces of damping, between steps

ENERGIES = ("stretch", "bend", "twist", "torsion", "plasticity", "gravity", "spring", "contact")
STRETCHING, BENDING, TWISTING, TORSIONAL, PLASTIC, WEIGHT, SPRING, TOUCHING = range(8)

# Where the factors of the last Newton matrix are: in `state.matrix`, or elsewhere for one step.
IN_STATE, IN_SKYLINE = range(2)
OK, DIVERGED, NOT_CONVERGED = 0, 1, 2  # outcome of an advance


class Mesh(Group):
    """Knot spans and quadrature points, constants."""

    slopes = Lanes("blocks", 12)  # r' = A + B xi + C xi^2: 3 k + power of control point k
    values = Lanes("blocks", 4)  # basis functions at xi = 0
    padding = Lanes("blocks")  # 1 on lanes beyond the last span, which get a unit tangent
    slope = Lanes("blocks")  # d xi / du = 2 / h [1/m]
    share = Lanes("blocks")  # 1 / h [1/m]
    linear = Lanes("blocks")  # 3 where the strain of a span has a linear part, else 0
    axial = Lanes("blocks")  # EA [N], of a cable of constant length the penalty factor
    bending = Lanes("blocks")  # EI [N m^2]
    torsional = Lanes("blocks")  # GJ [N m^2]
    guard = Lanes("blocks", 2)  # h EA_g k and h EA_g k_c of `engine.span_guard` [N m]
    xi = Lanes("blocks", "samples")  # local coordinate, -1 to 1
    weight = Lanes("blocks", "samples")  # of the quadrature [m]
    branch = Wholes("n")  # strand of each control point
    strand = Wholes("strands", 2)  # its first control point, and the one behind its last
    number = Lanes("blocks")  # of the strand of a span, -1 of void ones
    length = Reals("strands")  # [m]
    radius = Reals("strands")  # [m]


class Physics(Group):
    """Constants of the cable and its surroundings."""

    GJ = Number()  # of the first strand [N m^2]
    torsion_floor = Number()  # squared curvature floor [1/m^2]
    yield_moment = Number()  # [N m]
    hardening = Number()  # H / EI
    shortest_span = Number()  # [m]
    keeps_length = Number()  # 1 for a cable of constant length (`engine.tension`)
    axial_round_off = Number()  # EA L [N m] of `Mesh.axial`, 0 without stretching
    bending_round_off = Number()  # EI L [N m^3], 0 without bending
    drag_across = Number()  # c_n - c_t, normal minus tangential drag of air [N s/m^2]
    water_across = Number()  # k_n and k_t of `engine.drag` [N s^2/m^3]
    water_along = Number()
    water_current = Reals(3)  # velocity of the water by line [m/s]
    water_up = Reals(3)  # normal of its surface by line, over the radius of the cable [1/m]
    water_level = Number()  # height of its surface along that
    water_parts = Number()  # of a span, over which `engine.buoyancy` sums
    buoyancy = Number()  # of the whole section, times the radius [N]
    thrust = Number()  # pressure in a hose times the area of its bore [N]
    thinning = Number()  # lambda^2 of `terms.viscosity` [(m s)^2]
    beta_stretch = Number()  # internal damping [s]
    beta_bend = Number()
    beta_twist = Number()


class Linear(Group):
    """Constant band matrices on single lines: 7 diagonals, entry (i, i + k - 3) at [k, column i];
    the first of two is that of a spatial line, the second that of the twist line.
    """

    mass = Reals(2, 7, "columns")  # M
    factors = Reals(2, 7, "columns")  # of M: L[k, k-3 .. k-1], 1 / D, L[k+1 .. k+3, k]
    damping = Reals(2, 7, "columns")  # C of the linear damping
    twist = Reals(7, "twist_columns")  # GJ integral b' b'
    frame_factors = Reals(7, "bishop_columns")  # of integral b' b', first of a strand fixed
    greville = Reals("bishop_columns")  # Greville abscissae as shares of a strand
    weight = Reals("dim", "columns")  # generalised weight [N]
    decay = Reals("lines")  # rate of the external damping [1/s]


class Points(Group):
    """Places where the cable is held: sums of four control points with basis values b; of two
    branches, sums over four control points of each.
    """

    first = Wholes("points")  # control point
    other = Wholes("points")  # first of another branch, or -1
    own = Wholes("points")  # control point that coincides with it, or -1
    twist = Wholes("points")  # 1 on the twist line, 0 in space
    weights = Reals("points", 4)  # b
    other_weights = Reals("points", 4)  # b on the other branch
    sum = Reals("points")  # of b: 1 for a position, 0 for r' or between two branches
    shift = Reals("points", "columns")  # M^-1 b
    product = Reals("points", "points")  # b of the first . M^-1 b of the second


class Rows(Group):
    """Constraint rows: direction . (sum_k b_k x_k) = target. The first `count` are rigid; the other
    ones are springs, which give: they pull with stiffness (target - value).
    """

    count = Whole()
    border = Whole()  # how many, the last rigid ones, are at places between control points
    springs = Whole()
    joints = Whole()  # how many, the first springs, are between two branches
    point = Wholes("rows")
    grasp = Wholes("rows")  # -1 between two branches
    line = Wholes("rows")  # that it prescribes, -1 if its direction turns with its grasp
    body = Reals("rows", 3)  # that direction in the frame of the grasp
    stiffness = Reals("rows")  # [N/m], or [N m/rad] of r' and of the twist
    aims = Wholes("rows")  # 1 if the target is the direction of the grasp
    xi = Reals("rows")  # of the twist: local coordinate in its span


class Slides(Group):
    """Grasps that let the cable slide (`engine.sliding`)."""

    count = Whole()
    grasp = Wholes("slides")
    law = Reals("slides", 4)  # `sliding.STIFFNESS` to GRIP
    stops = Reals("slides", 2)  # material coordinates between which it slides [m]
    breaks = Reals("n")  # material coordinates of the ends of the knot spans [m]


class Bodies(Group):
    """Rigid bodies, of four control points that are at most three apart (`engine.rigid_body`)."""

    point = Wholes("bodies", 4)  # control points of the origin and of the directors' ends
    idle = Wholes("bodies", 4)  # 1 for a control point that is of the body only
    length = Reals("bodies", 3)  # l [m]; negative where a director points to the origin
    stiffness = Reals("bodies")  # K [J]


class Rolls(Group):
    """Border rows between the twist angle at a place of a strand and the roll of a body
    (`engine.roll`); the rigid ones first.
    """

    rigid_rolls = Whole()  # how many are rigid
    body = Wholes("rolls")
    first = Wholes("rolls")  # control point of the strand
    weights = Reals("rolls", 4)  # basis values of theta
    along = Reals("rolls", 3)  # tangent of the strand in the directors of the body
    side = Reals("rolls", 3)  # a vector of the body that is not parallel to it, likewise
    stiffness = Reals("rolls")  # [N m/rad], of those that give


class Loads(Group):
    """Places of point wrenches."""

    count = Whole()
    first = Wholes("loads")  # control point
    basis = Reals("loads", "columns")  # basis values
    values = Reals("loads", 4)  # the same, those that are not zero
    slopes = Reals("loads", 4)  # their derivatives [1/m]


class Contact(Group):
    """Obstacles, and the samples of the cable that touch them (`engine.contact`)."""

    count = Whole()  # obstacles
    pieces = Whole()  # groups of a span that touch all but rings and channels
    guide_pieces = Whole()  # groups of a span that touch rings and channels, the last ones
    extras = Whole()  # groups that touch all, between those two, of places beside the cable
    begin = Wholes("obstacles")  # first group that touches each obstacle
    end = Wholes("obstacles")  # behind the last one
    first = Wholes("groups")  # column of the first control point of their span
    basis = Lanes("groups", 4)  # basis functions
    slope = Lanes("groups", 4)  # their derivatives by the local coordinate
    weight = Lanes("groups")  # [m], 0 where there is no sample
    place = Lanes("groups")  # material coordinate on its strand [m]
    wider = Lanes("groups")  # by which the radius exceeds `radius` [m]; with meshes not above 0
    heavier = Lanes("groups")  # mass per length over `density`
    core = Wholes("obstacles")  # HALF_SPACE, BOX, CYLINDER, TUBE or MESH
    half = Reals("obstacles", 3)  # size of the core along its axes
    reach = Reals("obstacles")  # by which the core is grown [m]
    middle = Reals("obstacles")  # depth near its middle [m]
    extent = Reals("obstacles")  # of the core from its centre, that a rotation moves [m]
    law = Reals("obstacles", 3)  # `contact.STIFFNESS` to FRICTION
    field = Reals("obstacles", 10)  # of meshes (`distance_field.ORIGIN` to HIGH)
    field_shape = Wholes("obstacles", 4)  # points of its grid by axis, first of its values
    field_values = Reals("field_values")  # coefficients of the splines of all meshes [m]
    still = Reals(3)  # centre of the lines: the constant coordinate of planar motion [m]
    density = Number()  # mass per length [kg/m]
    radius = Number()  # of the cable, with which `reach` counts [m]
    leverage = Number()  # most by which a sample moves in the motion of its control points
    restitution = Number()
    least_margin = Number()  # of the broad phase [m]


class Chain(Group):
    """The cable as a chain of short segments that touch each other (`engine.self_contact`)."""

    segments = Whole()  # of a span
    basis = Lanes("chain_blocks", "corners", 4)  # basis functions at the corners of a span
    arc = Reals("chain_spans")  # material coordinate on its strand where a span begins [m]
    length = Reals("chain_spans")  # of a segment [m], 0 of void spans
    radius = Reals("chain_spans")  # [m]
    apart = Reals("chain_spans")  # along a strand, at which segments may touch [m]
    joints = Reals("chain_joints", 5)  # `self_contact.ONE` to BESIDE
    law = Reals(5)  # `self_contact.STIFFNESS` to FRICTION
    diameter = Number()  # largest [m]


class Inputs(Group):
    """Set by the caller."""

    motion = Reals("grasps", MOTION_SIZE)  # of the grasps (`engine.grasps`)
    obstacle = Reals("obstacles", MOTION_SIZE)  # motion of the obstacles, as of a grasp
    load = Reals("loads", 7)  # force (3) [N], torque (3) [N m], frequency [Hz]


class State(Group):
    """Everything that a step changes; a snapshot holds all of it."""

    x = Reals("lines", "columns")  # positions [m], twist angle [rad]
    w = Reals("lines", "columns")  # projected velocity P v (`engine.rows`)
    history = Reals(2, "lines", "columns")  # the two configurations before
    acceleration = Reals("lines", "columns")  # of the step before (`methods.zhai`)
    loaded = Reals("lines", "columns")  # load forces of the last evaluation
    counted = Reals("lines", "columns")  # positions up to which the account has the work
    reference = Reals("bishop_lines", "columns")  # positions at the end of the last step
    direction = Reals("rigid", 3)  # of the rows, by line
    inverse = Reals("rigid", "rigid")  # S^-1 along these directions (`engine.rows`)
    pull = Reals("rigid")  # S^-1 B M^-1 f, force of the cable on the grasps, last evaluation
    moved = Reals("rigid")  # prescribed displacement since then
    reaction = Reals("rigid")  # mean force over the last step
    reaction_before = Reals("rigid")  # over the step before
    tension = Lanes("blocks", "samples")  # over EA, as last predicted (`engine.tension`)
    stress = Reals("bodies", 6)  # over K, as last predicted (`engine.rigid_body`)
    anchor = Reals("rows")  # targets of the springs, behind the rigid rows
    anchor_counted = Reals("rows")  # targets up to which the account has the work
    slide = Reals("slides")  # material coordinate that it holds [m], or `sliding.LOST`
    slide_pose = Reals("slides", 12)  # of its gripper at the start and the end of a step, by line
    frame = Reals("grasps", FRAME_SIZE)  # in which a gripper's twist angle counts (`engine.grasps`)
    roll = Reals("rolls", ROLL_SIZE)  # from which the roll of a body counts (`engine.roll`)
    matrix = Reals("unknowns", "width")  # LU factors of the last Newton matrix
    energy = Reals(len(ENERGIES))  # potential energies [J]
    energy_begin = Reals(len(ENERGIES))  # the same at the start of the account
    balance = Numbers(
        "load_work",  # [J]
        "drive_work",  # of the grasps [J]
        "dissipated",  # [J]
        "energy_start",  # [J]
        "error",  # largest |energy - start - work + dissipated| so far [J]
        "exchanged",  # largest kinetic energy, work or change of one potential so far [J]
        "floor",  # energy below which differences are round-off [J]
        "pending",  # estimate of the work since the last evaluation, not yet above [J]
        "is_counted",  # 1 once the state holds the forces of an earlier evaluation
        "known",  # number of steps in the history
        "length",  # of the last implicit step [s]
        "length_before",  # of the one before [s]
        "reactions",  # steps whose reactions are known, up to 2
        "plastic_work",  # [J]
        "torsion_looks",  # counts of samples with suppressed torsion: how many
        "torsion_sum",
        "torsion_worst",
        "torsion_last",
        "matrix_weight",  # factor of the mass in `matrix` [1/s^2], 0: no matrix
        "matrix_shrinking",  # contraction of the corrections, as last measured
        "matrix_wait",  # steps that must factorise anew before a matrix is reused
        "matrix_setbacks",  # log2 of the next such wait
        "contact_margin",  # by which the cable may move until `near` is found anew [m]
        "contact_way",  # by how much cable and obstacles moved since [m]
        "contact_carried",  # by how much obstacles move in this step [m]
        "extrapolated_share",  # of the second difference that `implicit.predict` extrapolates
        "stopped",  # 1 if the last step had impulses of contact
        "decaying",  # 1 if overlap of a sample with an obstacle decays
        "contact_deep",  # samples and steps near the middle of an obstacle
        "pairs",  # of segments that may touch in a step (`self_contact`)
        "pairs_lost",  # for which there was no room in accepted steps
        "crossed",  # steps in which the cable passed through itself
        "pair_overlap",  # by which the cable touches itself with a smaller diameter [m]
        "pair_overlap_end",  # this at the end of the step
        "overlap",  # by which strands overlapped when the run began [m]
        "near_spans",  # pairs of spans in `near_pair`
        "near_margin",  # by which control points may move until these are found anew [m]
        "near_way",  # by how much they moved since, relative to each other [m]
        "near_turn",  # by how much edges between them changed since, in their lengths
        "near_fold",  # 1 if this step may fold stretches that were straight
        "slip",  # share of the plastic flow of a step that its forces contain
    )
    natural = Lanes("curved_blocks", "samples", 4)  # weight EI kappa0 (3), rest twist [rad/m]
    plastic = Lanes("plastic_blocks", "samples", 9)  # curvature; tangent, curvature before
    pose = Reals("obstacles", 36)  # at the start, the middle and the end of a step (`contact`)
    deepest = Reals("obstacles")  # that it pressed the cable in, so far [m]
    # Force per length of the impulses of contact in the last step, by line [N/m].
    stopped = Lanes("obstacles", "groups", 3)
    slides = Lanes("obstacles", "groups", 1)  # 1 where a sample slides, 0 where it lands or rests
    lain = Lanes("obstacles", "groups", 1)  # [s] for which a sample that was pressed still lies
    near_count = Reals("obstacles")
    near = Reals("obstacles", "groups")  # so many groups of samples that may touch the obstacle
    bristle = Lanes("obstacles", "groups", 3)  # friction that sticks, in its frame [m]
    # Overlap that decays: by how much less an obstacle reaches to a sample at the start and end of
    # a step [m]; and how deep the sample was in it, without that, at the start of the last one.
    overlap = Lanes("obstacles", "groups", 3)
    near_pair = Reals("near_pairs")  # spans a <= b that may touch: a times spans plus b
    pair = Reals(4, "pairs")  # segments that may touch (`self_contact.key_of`), bristle [m]


class Work(Group):
    """Working memory; nothing in it is needed after a call."""

    force = Reals("lines", "columns")
    load = Reals("lines", "columns")
    v0 = Reals("lines", "columns")
    v1 = Reals("lines", "columns")
    before = Reals("lines", "columns")  # positions at the start of a step with a sample time
    rates = Reals("rigid")  # of the targets, or residuals of the constraints
    targets = Reals("rigid")
    held = Reals("grasps", 23)  # of grasps at a requested time (`rows.ROTATION` to RATES)
    ahead = Reals("rigid", 3)  # directions at a requested time
    system = Reals("rigid", "rigid")  # S
    multipliers = Reals("rigid")  # S^-1 times `rates`
    slid = Reals("slides")  # material coordinates at the end of the step
    energies = Reals(len(ENERGIES) + 1)  # by term; last the sum of |summands| of the weight
    results = Numbers(
        "kinetic",  # [J]
        "total",  # energy [J]
        "evaluations",  # of forces, or Newton iterations, in a call of `methods.advance`
        "forces_known",  # 1 while `force` is that of the present state, for explicit methods
        "power",  # of the grasps at the present state [W] (`methods.runge_kutta`)
        "grounded",  # border rows that undo groundings (`border.ground_border`)
        "border_known",  # whether border rows but rolls stay from step to step (`border.KNOWN`)
        "whole_rolls",  # 1 where rolls balance the residual with all of F (`engine.border`)
        "coupled",  # where the factors of the step are: IN_STATE or IN_SKYLINE
        "decaying",  # that of the balance at the start of the step
        *("contact_work", "contact_loss"),  # of the last forces [J] (`contact.add_force`)
        *("contact_jumps", "contact_deep"),  # samples that passed an obstacle, or near its middle
        "pair_loss",  # of the last `self_contact.add_force` [J]
        "pair_work",  # of the diameter that grows back, likewise [J]
        "pairs_beyond",  # for which there is no room in this step
    )
    # twist relative to the Bishop frame
    psi = Reals("bishop_columns")
    tau = Lanes("bishop_blocks", "samples")
    moment = Lanes("bishop_blocks", "samples")  # of the last forces, times the weight [N m^2]
    # implicit steps
    start = Reals("lines", "columns")  # configuration at the start of the step
    start_v = Reals("lines", "columns")  # velocity there
    change = Reals("lines", "columns")  # q1 - q0
    second_difference = Reals("lines", "columns")  # of the last three configurations
    middle = Reals("lines", "columns")  # configuration in the middle of the step
    rate = Reals("lines", "columns")  # an acceleration, or a velocity at the end of the step
    damping = Reals("lines", "columns")  # damping force
    inertia = Reals("lines", "columns")
    old_direction = Reals("rigid", 3)  # at the start of the step
    old_inverse = Reals("rigid", "rigid")
    middle_direction = Reals("rigid", 3)
    row_force = Reals("rigid")  # reactions
    band = Reals("unknowns", "width")
    residual = Reals("padded")  # all unknowns, from PADDING on
    unbalanced = Reals("unknowns")  # right-hand side of the last correction
    step = Reals("unknowns")  # a correction in world coordinates
    nudge = Reals("lines", "columns")  # the same by line
    corrections = Reals(MOST_CORRECTIONS, "unknowns")  # with the present matrix
    correction_scale = Reals(MOST_CORRECTIONS)  # 1 / |s|^2 of each
    factors = Lanes("samples", 93)  # of the Jacobian of a block (`engine.elastic`)
    force_moments = Lanes(4, 3)  # for the projected strain: 1, xi, xi^2, xi^3 by direction
    strain_moments = Lanes(4, 3)
    flow_moments = Lanes(4, 3)
    tension_before = Lanes("blocks", "samples")  # the last correction
    stress_before = Reals("bodies", 6)
    tension_start = Lanes("blocks", "samples")  # the step
    guard = Lanes(25)  # gradient of the span guard on a block, and factors of its Jacobian
    pairs = Reals("pairings", 16, "columns")  # entries between two control points of each span
    pair_sums = Reals(7, groups.LANES)
    coupled_end = Wholes("n")  # control point behind those that the matrix couples with each
    border_at = Wholes("bordered", 2)  # first of the 4 lines unknowns of both places, or -1
    border_force = Reals("bordered", 2, "seen")  # F, without unknowns that other rows fix
    border_push = Reals("bordered", 2, "seen")  # F with them
    border_condition = Reals("bordered", 2, "seen")  # C
    border_compliance = Reals("bordered")  # 0 for rigid rows
    border_gap = Reals("bordered")  # by which rigid rows are still open
    held_point = Wholes("n")  # 1 for control points of which other rows fix something
    border_free = Wholes("bordered", 2)  # 1 for places of rows that touch none of these
    border_gram = Reals("kept_rows", "border_columns")  # (P F^T)^-1 of the rigid rows
    border_shift = Reals("padded", "border_columns")  # Z, from row PADDING on
    border_some = Reals("bordered_padded", SOME)  # columns of Z that are not zero on one strand
    border_system = Reals("bordered", "border_columns")  # (C Z + compliance)^-1
    border_share = Reals("border_columns")
    border_signs = Reals("bordered", "bordered")
    border_order = Wholes("bordered")
    border_spare = Reals("unknowns")
    roll_force = Reals("rolls", 2, "seen")  # rows of F, in world coordinates: strand, body
    roll_condition = Reals("rolls", 2, "seen")  # rows of C
    roll_moment = Reals("rolls")  # of the body on the strand [N m]
    columns = Reals("rigid", "unknowns")  # of the matrix, by row (`methods.relax_step`)
    border_value = Reals("border_columns")
    trial = Lanes("obstacles", "groups", 3)  # bristles at the end of the step
    impulses = Lanes("obstacles", "groups", 18)  # `contact.UNIT` to HELD
    looked = Reals(13, groups.LANES)  # distances, then places (`engine.distance_field`)
    measured = Lanes("obstacles", "groups", 2, 17)  # where samples are (`contact.measure`)
    touch = Lanes("obstacles", "groups", 12)  # `contact.PRESSURE` to LEVER, of the last forces
    touched = Wholes(1)  # tells which samples touch and slide (`contact.add_force`)
    contact_sums = Reals(160, groups.LANES)  # derivatives between the control points of a span
    # contact of the cable with itself (`engine.self_contact`)
    near_room = Reals("near_pairs")  # by which two spans may move towards each other in a step [m]
    fresh_pair = Reals(4, "pairs")
    corner = Reals("corner_rows", "chain_spans")  # corners of the chain: 3 number + line
    corner_push = Reals("corner_rows", "chain_spans")  # forces there
    beside = Reals("chain_blocks")  # 1 where a block has a segment of a pair
    pair_ends = Reals(28, "pairs")  # `self_contact.gather`
    pair_law = Reals(25, "pairs")  # of the last `self_contact.add_force`
    pair_force = Reals(12, "pairs")  # on both ends of both segments
    pair_trial = Reals(3, "pairs")  # bristles at the end of the step
    pair_side = Reals(12, 32)  # `self_contact.couple`
    pair_at = Wholes(32)
    skyline = Reals("skyline")  # see `engine.skyline`
    skyline_begin = Wholes("coupled")
    skyline_place = Wholes("coupled")
    skyline_pivot = Reals("coupled")
    # explicit steps
    x_rate = Reals(MOST_STAGES, "lines", "columns")
    w_rate = Reals(MOST_STAGES, "lines", "columns")
    x_begin = Reals("lines", "columns")
    w_begin = Reals("lines", "columns")
    mean_rate = Reals("lines", "columns")


class CableArrays(Group):
    """All arrays of a cable."""

    terms = Whole()  # bits of the active terms
    dim = Whole()  # spatial lines, 2 or 3
    lines = Whole()  # with the twist line
    n = Whole()  # control points
    blocks = Whole()
    samples = Whole()  # quadrature points of a span
    columns = Whole()
    grasps = Whole()
    axes = Wholes(3)  # world axis of the spatial lines
    mesh: Mesh
    physics: Physics
    linear: Linear
    points: Points
    rows: Rows
    slides: Slides
    bodies: Bodies
    rolls: Rolls
    loads: Loads
    contact: Contact
    chain: Chain
    inputs: Inputs
    state: State
    work: Work


class Method(Group):
    """Constants of the time integrator; every family has its own (`core.methods`)."""

    family = Whole()  # its bit
    check_every = Whole()  # steps between two checks of the energy
    stages = Whole()  # or substeps of a composition
    drift = Reals("stages")  # splitting methods
    kick = Reals("stages")
    matrix = Reals("stages", "stages")  # Runge-Kutta methods: a_ij
    weights = Reals("stages")  # b_j
    nodes = Reals("stages")  # c_i
    substeps = Reals("stages")  # implicit methods: lengths in units of the step
    conserves_energy = Whole()  # whether the elastic forces are minus the discrete gradient
    tolerance = Number()  # of the energy, relative to that exchanged so far
    halvings = Whole()  # how often a step may be halved


class Records(Group):
    """Dense output of a run (`engine.sampling`)."""

    times = Reals("count")  # of the samples [s], rising
    x = Reals("count", "lines", "columns")
    energy = Reals("count")  # at the end of the step [J]
    marks = Wholes(1)  # index of the next sample


CABLE, METHOD, RECORDS = CableArrays.kind, Method.kind, Records.kind
LINES, VECTOR = groups.MATRIX, groups.VECTOR  # types of lines, and of plain vectors
cable_at, method_at, records_at = map(group_at, (CableArrays, Method, Records))
