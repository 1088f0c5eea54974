"""How fast a device is in double precision, guessed from what it says of itself: enough to choose among several."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

# Multiply-adds in doubles that a compute unit makes in a clock, by what its architecture's name begins with, the
# longest that fits. NVIDIA: "Arithmetic Instructions" of the CUDA programming guide; AMD: the data sheets,
# peak rate over units and clock (a unit of gfx10 and later is a pair); Intel: the Max series' product page.
DOUBLES_A_CLOCK: Mapping[str, int] = MappingProxyType(
    {
        "sm_3": 64,
        "sm_5": 4,
        "sm_6": 4,
        "sm_60": 32,
        "sm_70": 32,
        "sm_75": 2,
        "sm_8": 2,
        "sm_80": 32,
        "sm_9": 64,
        "sm_10": 64,
        "sm_103": 2,
        "sm_12": 2,
        "gfx9": 4,
        "gfx906": 32,
        "gfx908": 32,
        "gfx90a": 64,
        "gfx94": 64,
        "gfx95": 64,
        "gfx10": 8,
        "gfx11": 8,
        "gfx12": 8,
        "data center gpu max": 16,
    }
)
OF_PROCESSORS, OF_OTHERS = 8, 2  # where nothing else is known


def name_architecture(handle: Any) -> str:
    """sm_90 of an NVIDIA device, which has an inquiry for it; otherwise what its name says."""
    try:
        return f"sm_{handle.compute_capability_major_nv}{handle.compute_capability_minor_nv}"
    except Exception:  # pyopencl's, or no such attribute: a device of another maker
        return str(handle.name).strip().casefold()


def estimate_rate(architecture: str, kind: str, units: int, clock: float) -> float:
    """Operations in doubles a second, a multiply-add being two: units times clock (Hz) times what a unit does in one.

    >>> print(f"{estimate_rate('sm_89', 'gpu', 128, 2.52e9):.2e}")
    1.29e+12
    """
    if kind == "cpu":
        each = OF_PROCESSORS
    else:
        fits = [begin for begin in DOUBLES_A_CLOCK if begin in architecture.partition(":")[0]]
        each = DOUBLES_A_CLOCK[max(fits, key=len)] if fits else OF_OTHERS
    return 2.0 * each * units * clock
