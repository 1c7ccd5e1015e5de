"""Where things are: four arrays of numbers, and whole numbers that say what is where in them.

    shape    counts, bits of the terms, and the offsets of everything below   (whole numbers)
    model    what never changes: mesh, mass, stiffnesses, what is held where
    inputs   what callers change: motions of grasps, loads
    state    what a step changes and a snapshot holds: all of it
    scratch  what no step needs of the one before

A *line* holds one coordinate of all control points (x, y, z of the scene's axes, then the twist
angle), with a margin of zeros before and after, so that whole vectors can be loaded at its ends.
Entry k of a line lies at margin + k stride. Stride 1 is one cable, whose lanes are neighbouring
spans; stride LANES is eight cables side by side, whose lanes are the cables. A *row* is LANES
numbers: one number eight times, or one of every cable.
"""

from __future__ import annotations

MARGIN = 3  # control points

# -- shape: counts ------------------------------------------------------------------------------
DIM = 0  # spatial lines, 2 or 3
LINES = 1  # with the twist line
N = 2  # control points
STRIDE = 3
LINE = 4  # entries of a line
SIZE = 5  # entries of all lines
BLOCKS = 6  # vectors of LANES spans
PARTS = 7  # vectors that cover the control points of a line
SAMPLES = 8  # quadrature points of a span
TERMS = 9  # bits below
AXES = 10  # world axis of spatial lines 0, 1, 2 (3 entries)
POINTS = 13  # held points
HELD = 14  # held rows
SPRINGS = 15  # rows held through a stiffness
GRASPS = 16
LOADS = 17
BORDER = 18  # held rows between control points, the last ones (`engine.border`)
PLANES = 19  # obstacles (`engine.contact`)

# -- shape: offsets in model --------------------------------------------------------------------
MESH = 20
MASS = 21  # 7 lines of space, 7 of twist: coefficients of control points k - 3 .. k + 3
FACTORS = (
    22  # 7 lines each: L[k, k-3], L[k, k-2], L[k, k-1], 1 / D, L[k+1, k], L[k+2, k], L[k+3, k]
)
WEIGHT = 23  # generalised weight, one line each spatial line [N]
TWIST = 24  # 7 lines: GJ integral b' b'
VISCOUS = 25  # 7 lines of space, 7 of twist: C of the linear damping
BETA = 26  # 3 rows: internal damping of stretching, bending, twisting [s]
DECAY = 27  # rows, one a line: rate of the external damping [1/s]
HELD_WEIGHTS = 28  # 5 rows a held point: basis values and their sum
HELD_SHIFT = 29  # a line a held point: M^-1 times its basis values
HELD_PRODUCT = 30  # rows, points x points: basis values of the first . shift of the second
HELD_BODY = 31  # 4 rows a held row: direction in the frame of its grasp, or of the lines
SPRING = 32  # 7 rows a spring row: basis values, stiffness [N/m or N m/rad], 1 of a place or 0 of
# a tangent, of a roll its local coordinate
LOAD_BASIS = 33  # a line a load: its basis values
LOAD_POINT = 34  # 8 rows a load: basis values, slopes [1/m]
SCALES = 35  # rows below
FRAME_FACTORS = 36  # 7 lines, as FACTORS: of integral b' b', the first control point held; shares
# of the length up to every Greville point
PLANE = 37  # 4 rows a plane: its normal on the lines, and where it is along that [m]
# -- shape: offsets in inputs -------------------------------------------------------------------
MOTION = 40  # MOTION_SIZE numbers a grasp (`engine.grasps`)
LOAD = 41  # 7 rows a load: force (3), torque (3), frequency
# -- shape: offsets in state --------------------------------------------------------------------
X = 50  # positions, SIZE
W = 51  # momentum variable, SIZE
HISTORY = 52  # two configurations before and an acceleration, 3 SIZE
LOADED = 53  # load forces of the last evaluation, SIZE
BOOKED = 54  # positions up to which work is booked, SIZE
DIRECTION = 55  # 4 rows a held row, world frame
INVERSE = 56  # rows, held x held: of the products (rows . shifts) along these directions
PULL = 57  # rows, held: what the forces of the last evaluation put on what is held
MOVED = 58  # rows, held: how far it moved since
REACTION = 59  # rows, held: mean force over the last step
ANCHOR = 60  # rows, springs: what they pull to
ANCHOR_BOOKED = 63  # the same up to which work is booked
LEDGER = 61
NATURAL = 62  # NATURAL_ROWS a sample of every block (`engine.natural_curvature`)
RATES_BEFORE = 65  # rows, held: rates of the targets that the velocities belong to
PLASTIC = 64  # 6 rows a sample of every block: plastic curvature and the tangent it belongs to
REFERENCE = 66  # positions at the end of the last step, SIZE (`engine.bishop`)
MATRIX = 42  # factors of the last Newton matrix (`methods.implicit`)
FRAME_TURN = 67  # a row a grasp: by how much the frame of theta is behind its own [rad]
# -- shape: offsets in scratch ------------------------------------------------------------------
FORCE = 70
NEW_LOAD = 71
V0 = 72
V1 = 73
BEFORE = 74  # positions at the begin of a step that holds a sample
RATES = 75  # rows, held: scratch
TARGETS = 76  # rows, held: scratch
AHEAD = 77  # 4 rows a held row: directions at a time to come
SYSTEM = 78  # rows, held x held: scratch of their inversion
NOTES = 79  # NOTE_ROWS rows that pass results from one function to the next
# -- shape: tables of whole numbers -------------------------------------------------------------
POINT_TABLE = (
    80  # a held point: its first control point, 0 in space or 1 for twist, own point or -1
)
ROW_TABLE = 81  # a held row: its point, its grasp, its line or -1 if its direction turns
SPRING_TABLE = 82  # a spring row: first control point, grasp, line
LOAD_TABLE = 83  # a load: first control point
POINT_ENTRIES, ROW_ENTRIES, SPRING_ENTRIES = 3, 3, 3
POINT_ROWS, DIRECTION_ROWS, SPRING_ROWS, LOAD_ROWS, LOAD_POINT_ROWS = 5, 4, 7, 7, 8
BORDER_FORCES = 84  # 4 dim entries a border row: along what it pushes, of its control points
BORDER_CONDITIONS = 85  # the same: what it keeps
BORDER_GRAM = 86  # border x border
BORDER_SHIFTS = 87  # a padded vector of all unknowns a border row
BORDER_SYSTEM = 88  # border x border
BORDER_SPARE = 89  # all unknowns
BORDER_PUSHES = 69  # as BORDER_FORCES, with what is held otherwise
FRAME_SPARE = 68  # a line, and a row a sample of every block
FIRST_OWN = 90  # offsets of what one family of methods needs in scratch, see there
TABLES_START = 150

# -- rows of SCALES -----------------------------------------------------------------------------
STIFFNESS_GJ = 0  # GJ [N m^2]
TORSION_FLOOR = 1  # squared curvature floor [1/m^2]
YIELD_MOMENT = 2  # [N m]
HARDENING = 3  # H [N m^2]
SPAN_LENGTH = 4  # shortest span [m]
ROUND_OFF_AXIAL = 5  # EA L [N m], 0 without stretching
ROUND_OFF_BENDING = 6  # EI L [N m^3], 0 without bending
CONTACT_STIFFNESS = 7  # [N/m^2]
DRAG_ACROSS = 8  # beyond that along the cable [N s/m^2]
THINNING = 9  # of damping, squared [(m s)^2]
SCALE_ROWS = 10
PLANE_ROWS = 4

# -- rows of a block of the mesh ----------------------------------------------------------------
# 0..11: r' = A + B xi + C xi^2 from four control points: rows 3 k + (0, 1, 2) of control point k
PADDING = 12  # 1 on lanes without a span: they get a unit tangent
SLOPE = 13  # d xi / du = 2 / h [1/m]
SHARE = 14  # 1 / h [1/m]
LINEAR = 15  # 3 where the stretch of a span has a linear part, else 0
AXIAL = 16  # EA [N]
BENDING = 17  # EI [N m^2]
VALUES = 18  # values of the four basis functions at xi = 0
HEAD = 22
XI, QUADRATURE, SAMPLE = 0, 1, 2  # rows of a sample: xi, weight [m]
NATURAL_ROWS, PLASTIC_ROWS = 4, 6

# -- bits of the terms --------------------------------------------------------------------------
STRETCH = 1
SPAN_STRETCH = 2
BEND = 4
CURVED = 8  # naturally, or by plastic flow
TWISTED = 16
TORSION = 32
PLASTICITY = 64
GRAVITY = 128
DAMPED = 256  # linear damping and stiffness damping
BISHOP = 512  # twist against the Bishop frame
CONTACT = 1024
DRAG = 4096  # air drag that depends on the direction
THINNED = 16384  # damping of bending thins with its rate
STATIC_TWIST = 8192  # twist without inertia, at rest at the end of each step
MATERIAL = 2048  # natural curvature, and rest twist, in the material frame

# -- rows of the ledger [J] ---------------------------------------------------------------------
LOAD_WORK = 0
DRIVE_WORK = 1
DISSIPATED = 2
ENERGY_START = 3
ENERGY_ERROR = 4  # largest |energy - start - work + dissipated| so far
EXCHANGED = 5  # largest kinetic energy, work or change of one potential so far
FLOOR = 6  # energy below which differences mean nothing
PENDING = 7  # work since the last evaluation of forces, until that is booked
IS_BOOKED = 8  # 1 once the state holds the forces of an earlier evaluation
KNOWN = 9  # entries of the history that are known
LENGTH = 10  # [s] of the last implicit step, and of the one before
LENGTH_BEFORE = 11
HAS_REACTION = 12
PLASTIC_WORK = 13
TORSION_LOOKS = 14  # how often samples without torsion were counted, sum, largest, last
TORSION_SUM = 15
TORSION_WORST = 16
TORSION_LAST = 17
ENERGY = 18  # present energies by name
ENERGIES = ("stretch", "bend", "twist", "torsion", "plasticity", "gravity", "spring", "contact")
STRETCHING, BENDING_ENERGY, TWISTING, TORSIONAL = 0, 1, 2, 3
PLASTIC_ENERGY, WEIGHT_ENERGY, SPRING_ENERGY, CONTACT_ENERGY = 4, 5, 6, 7
ENERGY_BEGIN = ENERGY + len(ENERGIES)  # the same at the start
NOTE_ROWS = len(ENERGIES) + 3
MATRIX_WEIGHT = ENERGY_BEGIN + len(ENERGIES)  # mass in MATRIX over that of the model [1/s^2], or 0
MATRIX_SHRINKING = MATRIX_WEIGHT + 1  # of corrections, as the last step with two of them saw it
MATRIX_WAIT = MATRIX_SHRINKING + 1  # steps that make their own before one is kept again
MATRIX_SETBACKS = MATRIX_WAIT + 1  # log2 of the next such wait
LEDGER_ROWS = MATRIX_SETBACKS + 1
OF_HISTORY = (KNOWN, IS_BOOKED, PENDING, HAS_REACTION, MATRIX_WEIGHT)  # 0 where nothing is known

OK, DIVERGED, NOT_CONVERGED = 0, 1, 2
