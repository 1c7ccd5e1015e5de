"""Memory layout: four arrays of numbers, and a table of whole numbers that locates their fields.

    shape    counts, bits of the terms, and the offset of every field below   (whole numbers)
    model    constants: mesh, mass, stiffnesses, constraint rows
    inputs   set by the caller: motions of the grasps, loads
    state    everything that a step changes; a snapshot holds all of it
    scratch  working memory; nothing in it is needed after a call

A *line* holds one coordinate of all control points (x, y, z of the scene's axes, then the twist
angle). Zeros before and after it allow whole vectors to be loaded at its ends: entry k is at
(MARGIN + k) STRIDE. With stride 1 there is one cable, and the lanes of a vector are neighbouring
spans; with stride LANES there are eight cables, and the lanes are the cables. A *row* is LANES
numbers: one number eight times, or one for each cable. A *held row* is one scalar constraint by
which a grasp prescribes a coordinate of the cable (`engine.held`).
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
BLOCKS = 6  # vectors that cover the knot spans
PARTS = 7  # vectors that cover the control points of a line
SAMPLES = 8  # quadrature points of a span
TERMS = 9  # bits below
AXES = 10  # world axis of spatial lines 0, 1, 2 (3 entries)
POINTS = 13  # held points
HELD = 14  # held rows
SPRINGS = 15  # spring rows: a grasp that holds through a stiffness
GRASPS = 16
LOADS = 17
BORDER = 18  # the last held rows, at points between control points (`engine.border`)
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
DECAY = 27  # one row per line: rate of the external damping [1/s]
HELD_WEIGHTS = 28  # 5 rows per held point: basis values b and their sum
HELD_SHIFT = 29  # one line per held point: M^-1 b
HELD_PRODUCT = 30  # rows, points x points: b of the first . M^-1 b of the second
HELD_BODY = 31  # 4 rows per held row: direction in the frame of its grasp, or of the lines
SPRING = 32  # 7 rows per spring row: basis values; stiffness [N/m or N m/rad]; 1 for a position,
# 0 for a tangent; local coordinate of a roll
LOAD_BASIS = 33  # one line per load: its basis values
LOAD_POINT = 34  # 8 rows per load: basis values, slopes [1/m]
SCALES = 35  # rows below
FRAME_FACTORS = 36  # 7 lines, as FACTORS: of integral b' b' with the first control point fixed;
# then one line: Greville abscissae as shares of the length
PLANE = 37  # 4 rows per plane: components of its normal n, and d of n . r = d [m]
# -- shape: offsets in inputs -------------------------------------------------------------------
MOTION = 40  # MOTION_SIZE numbers per grasp (`engine.grasps`)
LOAD = 41  # 7 rows per load: force (3), torque (3), frequency
# -- shape: offsets in state --------------------------------------------------------------------
X = 50  # positions, SIZE
W = 51  # momentum variable, SIZE
HISTORY = 52  # the two configurations before and an acceleration, 3 SIZE
LOADED = 53  # load forces of the last evaluation, SIZE
BOOKED = 54  # positions up to which the ledger contains the work, SIZE
DIRECTION = 55  # 4 rows per held row, world frame
INVERSE = 56  # rows, held x held: S^-1 along these directions (`engine.held`)
PULL = 57  # rows, held: S^-1 B M^-1 f, the force of the cable on the grasps at the last evaluation
MOVED = 58  # rows, held: prescribed displacement since then
REACTION = 59  # rows, held: mean force over the last step
ANCHOR = 60  # rows, springs: target value of each spring
ANCHOR_BOOKED = 63  # target values up to which the ledger contains the work
LEDGER = 61
NATURAL = 62  # NATURAL_ROWS per sample of every block (`engine.natural_curvature`)
RATES_BEFORE = 65  # rows, held: target rates of the last velocity correction (`methods.rattle`)
PLASTIC = 64  # PLASTIC_ROWS per sample of every block (`engine.slip`)
REFERENCE = 66  # positions at the end of the last step, SIZE (`engine.bishop`)
MATRIX = 42  # LU factors of the last Newton matrix (`methods.implicit`)
FRAME_TURN = 67  # one row per grasp: lag of the frame of theta behind the grasp's frame [rad]
# -- shape: offsets in scratch ------------------------------------------------------------------
FORCE = 70
NEW_LOAD = 71
V0 = 72
V1 = 73
BEFORE = 74  # positions at the start of a step that contains a sample time
RATES = 75  # rows, held
TARGETS = 76  # rows, held
AHEAD = 77  # 4 rows per held row: directions at a requested time
SYSTEM = 78  # rows, held x held: S, and results of products with S^-1
NOTES = 79  # NOTE_ROWS rows that pass results from one function to the next
# -- shape: tables of whole numbers -------------------------------------------------------------
POINT_TABLE = (
    80  # per held point: first control point; 0 in space, 1 for twist; coincident one or -1
)
ROW_TABLE = 81  # per held row: point, grasp, line or -1 if its direction turns with the grasp
SPRING_TABLE = 82  # per spring row: first control point, grasp, line
LOAD_TABLE = 83  # per load: first control point
POINT_ENTRIES, ROW_ENTRIES, SPRING_ENTRIES = 3, 3, 3
POINT_ROWS, DIRECTION_ROWS, SPRING_ROWS, LOAD_ROWS, LOAD_POINT_ROWS = 5, 4, 7, 7, 8
BORDER_FORCES = 84  # F: 4 dim entries per border row, without unknowns fixed by other rows
BORDER_CONDITIONS = 85  # C: the same
BORDER_GRAM = 86  # (F F^T)^-1: border x border
BORDER_SHIFTS = 87  # Z: a padded vector of all unknowns per border row
BORDER_SYSTEM = 88  # (C Z)^-1: border x border
BORDER_SPARE = 89  # all unknowns
BORDER_PUSHES = 69  # F with the unknowns fixed by other rows
FRAME_SPARE = 68  # one line, and COUPLING_ROWS per sample of every block
FIRST_OWN = 90  # from here: offsets that each family of methods defines for itself
TABLES_START = 150

# -- rows of SCALES -----------------------------------------------------------------------------
STIFFNESS_GJ = 0  # GJ [N m^2]
TORSION_FLOOR = 1  # squared curvature floor [1/m^2]
YIELD_MOMENT = 2  # [N m]
HARDENING = 3  # H / EI
SPAN_LENGTH = 4  # shortest span [m]
ROUND_OFF_AXIAL = 5  # EA L [N m], 0 without stretching
ROUND_OFF_BENDING = 6  # EI L [N m^3], 0 without bending
CONTACT_STIFFNESS = 7  # [N/m^2]
DRAG_ACROSS = 8  # c_n - c_t, normal minus tangential drag [N s/m^2]
THINNING = 9  # lambda^2 of `terms.viscosity` [(m s)^2]
SCALE_ROWS = 10
PLANE_ROWS = 4

# -- rows of a block of the mesh ----------------------------------------------------------------
# 0..11: r' = A + B xi + C xi^2 from four control points: rows 3 k + (0, 1, 2) of control point k
PADDING = 12  # 1 on lanes beyond the last span, which get a unit tangent
SLOPE = 13  # d xi / du = 2 / h [1/m]
SHARE = 14  # 1 / h [1/m]
LINEAR = 15  # f of `engine.elastic`: 3 where the strain of a span has a linear part, else 0
AXIAL = 16  # EA [N]
BENDING = 17  # EI [N m^2]
VALUES = 18  # values of the four basis functions at xi = 0
HEAD = 22
XI, QUADRATURE, SAMPLE = 0, 1, 2  # rows of a sample: xi, weight [m]
NATURAL_ROWS, PLASTIC_ROWS, COUPLING_ROWS = 4, 9, 5

# -- bits of the terms --------------------------------------------------------------------------
STRETCH = 1
SPAN_STRETCH = 2
ANY_STRETCH = STRETCH | SPAN_STRETCH
BEND = 4
CURVED = 8  # natural or plastic curvature
TWISTED = 16
TORSION = 32
PLASTICITY = 64
GRAVITY = 128
DAMPED = 256  # linear damping and stiffness damping
BISHOP = 512  # twist against the Bishop frame
CONTACT = 1024
DRAG = 4096  # anisotropic air drag
THINNED = 16384  # rate-thinning viscosity of bending
GUARDED = 32768  # spans are kept from turning over (`terms.span_guard`)
STATIC_TWIST = 8192  # twist without inertia, in equilibrium at the end of each step
MATERIAL = 2048  # natural curvature, and rest twist, in the material frame

# -- rows of the ledger [J] ---------------------------------------------------------------------
LOAD_WORK = 0
DRIVE_WORK = 1
DISSIPATED = 2
ENERGY_START = 3
ENERGY_ERROR = 4  # largest |energy - start - work + dissipated| so far
EXCHANGED = 5  # largest kinetic energy, work or change of one potential so far
FLOOR = 6  # energy below which differences are round-off
PENDING = 7  # estimate of the work since the last evaluation of forces, not yet in the rows above
IS_BOOKED = 8  # 1 once the state holds the forces of an earlier evaluation
KNOWN = 9  # number of steps in the history
LENGTH = 10  # [s] of the last implicit step
LENGTH_BEFORE = 11  # [s] of the one before
HAS_REACTION = 12
PLASTIC_WORK = 13
TORSION_LOOKS = 14  # counts of samples with suppressed torsion: how many, then sum, largest, last
TORSION_SUM = 15
TORSION_WORST = 16
TORSION_LAST = 17
ENERGY = 18  # present potential energies, in the order of ENERGIES
ENERGIES = ("stretch", "bend", "twist", "torsion", "plasticity", "gravity", "spring", "contact")
STRETCHING, BENDING_ENERGY, TWISTING, TORSIONAL = 0, 1, 2, 3
PLASTIC_ENERGY, WEIGHT_ENERGY, SPRING_ENERGY, CONTACT_ENERGY = 4, 5, 6, 7
ENERGY_BEGIN = ENERGY + len(ENERGIES)  # the same at the start of the account
NOTE_ROWS = len(ENERGIES) + 3
MATRIX_WEIGHT = ENERGY_BEGIN + len(ENERGIES)  # factor of the mass in MATRIX [1/s^2], 0: no matrix
MATRIX_SHRINKING = MATRIX_WEIGHT + 1  # contraction of the corrections, as last measured
MATRIX_WAIT = MATRIX_SHRINKING + 1  # steps that must factorise anew before a matrix is reused
MATRIX_SETBACKS = MATRIX_WAIT + 1  # log2 of the next such wait
SLIP = MATRIX_SETBACKS + 1  # share of the plastic flow of a step that its forces contain
LEDGER_ROWS = SLIP + 1
OF_HISTORY = (KNOWN, IS_BOOKED, PENDING, HAS_REACTION, MATRIX_WEIGHT)  # 0 without earlier steps

OK, DIVERGED, NOT_CONVERGED = 0, 1, 2
