"""Run times: every rate, count of operations and threshold that predictions and choices are made by.

Rates are those of one thread of an idle processor of 2024, good to a factor of 3; n is the number of unknowns of a
hemisphere. A solve that will take long is announced before it starts, and refused beyond a limit.
"""

import math
from collections.abc import Mapping

from vrte.basics.errors import LongSolveWarning, SceneError, warn_user

# times [s]
LONG = 20.0  # a predicted run time above this is announced before the solve
TIME_LIMIT_S = 3600.0  # default of time_limit_s: longer solves are refused
LOOKING = 0.7  # time spent on predicting the run time of many solves, after which the rest is extrapolated
LOADING = 5.0  # the same while only one solve was predicted: its time may include loading what all others share
SECONDS_OF_TERMS = 1e-7  # time of a phase matrix of spheres over the square of its number of terms
SECONDS_OF_ORDERS = 2e-9  # time of a transition matrix in random orientation over the sixth power of its orders
A_CALL = 3e-3  # overhead of one solve beside its plan and its operations

# operations per second, compared with solves by tests/test_forecast.py
RATE: Mapping[str, float] = {
    "discrete-ordinates": 2.5e10,
    "adding-doubling": 2.2e10,
    "matrix-operator": 1.5e11,
    "invariant-imbedding": 2e10,
    "monte-carlo": 1e9,
    "single-scattering": 2.5e10,
    "successive-orders": 2.5e10,
}
PLANNING_RATE = 2e8  # rate of planning [1/s]: squares of Fourier orders times directions
# of a search for the nodes, by 15 scenes of 0.02 to 1.4 s: time over that of the count estimated; counts that it solves
SEARCHING, COUNTS = 2.6, 2.7
A_TRIAL = 8e-3  # time of each of them beside its operations
SMOOTH, ROUGH = (
    1e-2,
    2e-2,
)  # time of a solve beside its operations where light is refracted, by smooth or rough surfaces
VERIFYING = 4.0  # run time of verify=True, by both algorithms, over that of one

# operations of discrete ordinates over n^3, counted; lower powers of n are in the formulas
MODES_GENERAL, MODES_SYMMETRIC = 45.0, 18.0  # modes of a layer, the eigenproblem included: general, symmetric
BOUNDARY = 14.0  # boundary conditions between two layers
COLUMNS_A_TERM = {1: 1.0, 2: 2.0, 3: 3.0, 4: 4.0}  # right-hand sides of both parities by number of Stokes parameters
POLES, POLES_A_FACTOR = 3.0, 1.45  # poles of tanh, and more of them a factor of two in thickness over mu
SCATTERINGS, A_SCATTERING = 4.0, 2e4  # successive scatterings of a beam that take as long as modes; overhead of one
WORTH_SCATTERINGS = 0.8  # successive scatterings are taken below this predicted time over that of modes
SOLVING, DOUBLING = 60.0, 1000.0  # one order of a layer by modes and by doubling, estimated before there is a plan
# products of n x n matrices
PRODUCTS_A_STEP = 6.0  # in one doubling step, its inverse included
PRODUCTS_BESIDE = 16.0  # in the starting layer, reflection and transmission, and the check by invariance
PRODUCTS_A_JOINT = 8.0  # in adding two slabs
STEPS_ENDLESS = 8  # doubling steps of a semi-infinite layer
A_SPREADING = 500.0  # operations of the small-angle part, for a degree and direction
A_TERM = 45.0  # operations of the six series of single scattering, for a term
SCALAR_TERM = 0.25  # of these, where I alone is scattered
FLAKES, A_FLAKE_ORDER = 4e5, 0.15  # operations for a direction and a node of flakes, and more for each order; fitted
RESPONSE = 28.0  # of a slab between interfaces, over the nodes' unknowns times those with beams and directions of view
LOBES, PIECES = 2.1e3, 30.0  # operations of facets for a direction, a node and a squared point; nodes added, fitted
TOTALLY = 2.3  # time of facets that reflect totally over that of others
ORDERS = 550.0, 4.0  # squared Fourier orders that take as long as one: reflected; let through, times the lobe's width

# operations that take as long as what they stand for, over n^2 and unknowns on the nodes (docs/explanation/accuracy.md)
DOUBLING_STEP, ADDING = 9.0, 7.0  # a doubling step, whose rows off the nodes take half the time; adding a slab
OFF_SYMMETRIC, OFF_GENERAL = 2.5, 8.0  # a row off the nodes by modes: real ones, and where some are complex pairs
AN_INVARIANCE = 0.5  # time of an operation of invariance over one of modes: gold, hematite, 8 to 24 nodes
WORTH_DOUBLING = 0.7  # doubling is taken below this predicted time over that of modes, known to about a third

# sizes above which a measure pays that takes about a millisecond
WORTH_STAGES = 5e6  # cubes of unknowns: between Fourier orders, the number of orders left is found again
WORTH_THREADS_BOUNDS = 1e6  # spherical functions: bounds of the orders by several threads
WORTH_THREADS_STAGES = 1e5  # multiplications in products of matrices: all stages by several threads
WORTH_A_JOB = 1e6  # multiplications in products of matrices: in the Fourier orders that a thread takes at a time
WORTH_THREADS_SUMS = 1e5  # bytes of a result: its Fourier sums by several threads
BRIEF = 3e8  # operations of a request: below, it takes some milliseconds on one thread, and gets no other

# derivatives
ALGEBRA, ALGEBRA_SIZE = 3.5e6, 24.0  # operations of one, for an order and layer; and over (nodes + directions)^3
BY_INVARIANCE = 0.6  # time of one, of orders by invariance, over that of their light: gold, 24 to 64 nodes
ONCE = 2.0  # time of a derivative of single scattering over that of single scattering
GRADIENT, GRADIENT_ONCE = 3.5, 20.0  # time of an adjoint gradient over that of one derivative, of single scattering
DIFFERENCES = 7.0  # time of one by differences over that of a solve: four or five solves without skips, their plans

# operations of other methods, measured as seconds times their rate
SLAB_STEPS_ENDLESS = 25  # doubling steps of a semi-infinite slab
A_DOUBLING = 2e7  # overhead of a doubling step of one order, beside its products
STEPS_A_DEPTH, LEAST_STEPS, SWEEPS = 3.0, 12.0, 12.0  # imbedding: steps per optical depth, at least, sweeps a step
OVERHEAD = 3e5  # overhead of a call of NumPy


def warn_runtime(seconds: float, limit: float, why: str, change: str, warned: bool = False) -> None:
    """Warns of a long solve, unless the user was ``warned``. Raises SceneError beyond the limit in seconds."""
    if seconds <= min(LONG, limit):
        return
    words = f"this will take about {format_duration(seconds)}{why}; {change}"
    if seconds > limit:
        most = format_duration(limit)
        raise SceneError(f"{words}, or go on with time_limit_s above its {most} (math.inf for no limit)")
    if not warned:
        warn_user(words, LongSolveWarning)


def format_duration(seconds: float) -> str:
    """A time that is only roughly known, in s, min, h or days."""
    if seconds < 100.0 or not math.isfinite(seconds):
        return f"{seconds:.0f} s"
    if seconds < 6000.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h" if seconds < 172800.0 else f"{seconds / 86400.0:.3g} days"
