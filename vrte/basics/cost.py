"""What things cost, and from where on it is worth while: every rate, count of operations and threshold of time.

Rates are of one thread of a processor of 2024 with nothing else to do, and right to a factor of 3; n is the number of
unknowns of a hemisphere. What will take long is said before it starts, and refused beyond a limit.
"""

import math
from collections.abc import Mapping

from vrte.basics.errors import LongSolveWarning, SceneError, warn_user

# seconds
LONG = 20.0  # that are told
TIME_LIMIT_S = 3600.0  # beyond which a solve is refused, by default
LOOKING = 0.7  # after which no other one of many solves is looked at, to tell how long they take
LOADING = 5.0  # the same where only the first was looked at: it may have been loading what all others share
SECONDS_OF_TERMS = 1e-7  # of a phase matrix of spheres, over the square of its terms
SECONDS_OF_ORDERS = 2e-9  # of a transition matrix in random orientation, over the sixth power of its orders
A_CALL = 3e-3  # of any solve, beside its plan and its operations

# operations a second, held against solves by tests/test_forecast.py
RATE: Mapping[str, float] = {
    "discrete-ordinates": 2.5e10,
    "adding-doubling": 2.2e10,
    "matrix-operator": 1.5e11,
    "invariant-imbedding": 2e10,
    "single-scattering": 2.5e10,
    "successive-orders": 2.5e10,
}
PLANNING_RATE = 2e8  # squares of orders times directions
VERIFYING = 4.0  # times as long, by both algorithms

# operations of discrete ordinates over n^3, counted; lower powers of n are in the formulas
MODES_GENERAL, MODES_SYMMETRIC = 45.0, 18.0  # of a layer's modes, eigenproblem included
BOUNDARY = 14.0  # of a layer that meets another
COLUMNS_A_TERM = {1: 1.0, 2: 2.0, 3: 3.0, 4: 4.0}  # of both parities, by the number of Stokes parameters
POLES, POLES_A_FACTOR = 3.0, 1.45  # of tanh's partial fractions, and for each factor of two in thickness over mu
A_POLE = 6e4  # that the calls for a fraction take the time of
FRACTIONS_BESIDE = 5.0  # over n^3, of what comes after the fractions
SCATTERINGS, A_SCATTERING = 4.0, 2e4  # for a beam, of either half, in the time that modes take for it; its calls
WORTH_FRACTIONS = 0.8  # where they are predicted to take so much of the time of modes
SOLVING, DOUBLING = 60.0, 1000.0  # of an order and layer by modes and by doubling, before anything is planned
# products of matrices
PRODUCTS_A_STEP = 6.0  # of a doubling, its inverse included
PRODUCTS_BESIDE = 16.0  # start, reflection and transmission, and the check by invariance
PRODUCTS_A_JOINT = 8.0  # where two slabs meet
STEPS_ENDLESS = 8  # doublings of a layer without end
A_SPREADING = 500.0  # operations of a degree and direction, of light of small angles
A_TERM = 45.0  # operations of six series in closed form
RESPONSE = 100.0  # of a slab between interfaces, over the nodes' unknowns times those with beams and with sights
LOBES = 6e6  # operations of a direction and order of a rough interface

# time over that of a layer's modes, as measured (docs/explanation/accuracy.md)
JOINT = 0.2  # of a joint
DOUBLING_AT_ONCE, DOUBLING_SIZE = 0.1, 1500.0  # of a doubling, and the unknowns with which it takes as long again
WORTH_DOUBLING = 0.7  # where it is predicted to take so much: predictions are right to about a third

# from where on it is worth while, by what takes a millisecond or so
WORTH_STAGES = 5e6  # cubes of unknowns: look again, between orders, at how many are left
WORTH_A_BLOCK = 4e4  # cubes of unknowns: their time is that of one more block's calls
WORTH_THREADS_BOUNDS = 1e6  # spherical functions
WORTH_THREADS_STAGES = 1e5  # products of matrices, in multiplications, of all stages
WORTH_A_JOB = 1e6  # products of matrices, in multiplications: orders that a thread takes at a time
WORTH_THREADS_SUMS = 1e5  # bytes of a result
BRIEF = 3e8  # operations of a request: some milliseconds on one thread, which others would not shorten

# of derivatives
ALGEBRA, ALGEBRA_SIZE = 1.2e7, 80.0  # one derivative of an order and layer; over the cube of nodes and directions
ONCE = 2.0  # times light scattered once: a derivative of it
GRADIENT, GRADIENT_ONCE = 4.0, 20.0  # with everything at once: times one derivative, and times light scattered once
DIFFERENCES = 7.0  # times the solve, for each: four or five solves that leave nothing out, and their plans

# operations of other methods, measured as seconds times their rate
SLAB_STEPS_ENDLESS = 25  # doublings of a slab without end
A_DOUBLING, A_LAYER_OF_MODES = 2e7, 3.4e8  # that what is no product takes the time of, of an order
COMPLEX_MODES, A_DIFFERENCE = 500.0, 400.0  # over n^3, complex eigenvectors and functions of them; of a difference
STEPS_A_DEPTH, LEAST_STEPS, SWEEPS = 3.0, 12.0, 12.0  # of imbedding: an optical depth, at least, sweeps of each
OVERHEAD = 3e5  # that a call of NumPy takes the time of


def warn_runtime(seconds: float, limit: float, why: str, change: str, told: bool = False) -> None:
    """Says what will take long, unless that was ``told``. Raises SceneError beyond the limit in seconds."""
    if seconds <= min(LONG, limit):
        return
    said = f"this will take about {say_time(seconds)}{why}; {change}"
    if seconds > limit:
        raise SceneError(f"{said}, or go on with time_limit_s above its {say_time(limit)} (math.inf for no limit)")
    if not told:
        warn_user(said, LongSolveWarning)


def say_time(seconds: float) -> str:
    """A time that is only roughly known.

    >>> say_time(24.0), say_time(200.0), say_time(7200.0), say_time(1e6)
    ('24 s', '3 min', '2.0 h', '11.6 days')
    """
    if seconds < 100.0 or not math.isfinite(seconds):
        return f"{seconds:.0f} s"
    if seconds < 6000.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h" if seconds < 172800.0 else f"{seconds / 86400.0:.3g} days"
