"""Arrays of numbers from a user, checked; and arrays that were costly to make, remembered by what they were made of."""

import itertools
import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import NDArray

from vrte.basics.errors import SceneError

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int32]
Record = TypeVar("Record")

MOST_NUMBERS = 100_000_000  # of one argument: beyond, to look at them all would take all the memory
FEW = 32  # numbers of a list that are looked at one by one
SMALLEST_COSINE = 1e-8  # of light: nearer to the horizon, nothing is solved
EXACT = 2**53  # whole numbers below are doubles
SHOWN = 80  # characters of a value in an error message


def make_readonly(array: Array) -> Array:
    """The array itself, from now on read-only."""
    array.setflags(write=False)
    return array


def freeze_copy(values: Any) -> Array:
    """A read-only float64 copy, contiguous."""
    return make_readonly(np.array(values, dtype=np.float64, order="C"))


def is_readonly(values: Any) -> bool:
    """Whether this is a contiguous float64 array that nothing can be written into, nor into what it is a view of."""
    if type(values) is not np.ndarray or values.dtype != np.float64 or not values.flags.c_contiguous:
        return False
    while isinstance(values, np.ndarray):
        if values.flags.writeable:
            return False
        values = values.base
    return values is None


def freeze(values: Any) -> Array:
    """The array itself where it is read-only, else a copy that is."""
    return values if is_readonly(values) else freeze_copy(values)


def check_numbers(name: str, values: Any) -> Array:
    """Real numbers of any shape as float64; text, dates, complex numbers and truth values are none."""
    count = values.size if isinstance(values, np.ndarray) else count_items(values)
    if count > MOST_NUMBERS:
        raise SceneError.of(name, f"must be at most {MOST_NUMBERS} numbers, not {count}")
    try:
        return _read_real_array(values)
    except Exception:  # whatever a foreign object raises when it is asked for numbers
        raise SceneError.of(name, f"must be real numbers, not {show_value(values)}") from None


def check_vector(name: str, values: Any) -> Array:
    """A read-only, finite 1-D array; a scalar becomes one of length 1."""
    if type(values) is float and math.isfinite(values):
        return freeze_copy([values])
    if type(values) is list and len(values) <= FEW and all([type(value) is float for value in values]):
        array = freeze_copy(values)
    else:
        plain = type(values) is np.ndarray and values.dtype == np.float64 and values.size <= MOST_NUMBERS
        array = freeze_copy(np.atleast_1d(values if plain else check_numbers(name, values)))
    if array.ndim != 1 or array.size == 0:
        raise SceneError.of(name, f"must be a number or a non-empty 1-D list, not of shape {array.shape}")
    if not np.isfinite(array).all():
        raise SceneError.of(name, f"must be finite numbers, not {array[~np.isfinite(array)][0]}")
    return array


def check_cosines(name: str, values: Any, signed: bool = False) -> Array:
    """Cosines with 1e-8 <= |mu| <= 1, positive unless ``signed``."""
    array = check_vector(name, values)
    size = np.abs(array) if signed else array
    bad = ~((size >= SMALLEST_COSINE) & (size <= 1.0))
    if bad.any():
        worst = float(array[bad][0])
        allowed = "1e-8 <= |mu| <= 1 (above 0: up, below 0: down)" if signed else "1e-8 <= mu <= 1"
        meant = f"; {abs(worst):g} degrees have the cosine {math.cos(math.radians(worst)):.6g}" * (abs(worst) > 1.0)
        raise SceneError.of(name, f"must satisfy {allowed}, as cosines do, not {worst:g}{meant}")
    return array


def check_number(name: str, value: Any, low: float, high: float, allowed: str) -> float:
    """A float within [low, high]; `allowed` says in words what the range is."""
    try:
        result = read_real(value)
    except Exception:  # whatever a foreign object raises when it is asked for a number
        raise SceneError.of(name, f"must be a number ({allowed}), not {show_value(value)}") from None
    if not low <= result <= high:  # also refuses NaN
        raise SceneError.of(name, f"must be {allowed}, not {show_value(value)}")
    return result


def check_fields(of: str, one: object, limits: Mapping[str, tuple[float, float, str]]) -> None:
    """Makes numbers of a frozen dataclass floats within their limits; None stays. Raises SceneError."""
    for name, bounds in limits.items():
        if (value := getattr(one, name)) is not None:
            object.__setattr__(one, name, check_number(f"{of}{name}", value, *bounds))


def check_whole(name: str, value: Any, low: int, high: int) -> int:
    """An integer within [low, high]."""
    try:
        result = read_real(value)
    except Exception:
        result = math.nan
    if not (low <= result <= high and result.is_integer()):
        raise SceneError.of(name, f"must be a whole number from {low} to {high}, not {show_value(value)}")
    return int(result)


def check_choice(name: str, value: Any, allowed: Iterable[str]) -> str:
    """One of the names allowed."""
    if not (isinstance(value, str) and value in [*allowed]):
        raise SceneError.of(name, f"must be {', '.join(map(repr, allowed))}, not {show_value(value)}")
    return value


def check_flag(name: str, value: Any, allowed: str = "True or False") -> bool:
    """True or False; numbers such as 0 and 1 are refused."""
    if not isinstance(value, (bool, np.bool_)):
        raise SceneError.of(name, f"must be {allowed}, not {show_value(value)}")
    return bool(value)


def check_list(name: str, values: Iterable[Any], most: int) -> list[Any]:
    """The items of whatever can be iterated, at most ``most``: an iterator may have no end."""
    try:
        found = list(itertools.islice(values, most + 1))
    except Exception:
        raise SceneError.of(name, f"must be a list, not {show_value(values)}") from None
    if len(found) > most:
        raise SceneError.of(name, f"must be a list of at most {most}, not of more")
    return found


def read_real(value: Any) -> float:
    """One real number as a float, NaN for a whole number that no float can hold; else raises, TypeError or another."""
    if type(value) is float or (type(value) is int and abs(value) < EXACT):
        return float(value)
    array = _read_real_array(value)
    if array.ndim:
        raise TypeError("not one number")
    result = float(array)
    return math.nan if math.isinf(result) and isinstance(value, int) else result


def _read_real_array(values: Any) -> Array:
    """Conversion without a cast that loses something: numpy's own takes text and drops imaginary parts and masks."""
    given = np.asarray(values)
    if given.dtype.kind == "O":
        return np.array([_read_real_object(item) for item in given.flat], dtype=np.float64).reshape(given.shape)
    if given.dtype.kind not in "iuf" or np.ma.is_masked(values):
        raise TypeError("not a real number")
    with np.errstate(over="ignore"):  # a long double beyond the range becomes inf
        return given.astype(np.float64)


def _read_real_object(value: Any) -> float:
    """A number that numpy has no type for: a fraction, a decimal, a large integer."""
    if isinstance(value, np.generic):
        return float(_read_real_array(value))
    if isinstance(value, (str, bytes, bytearray, bool, complex, np.ndarray)):
        raise TypeError("not a real number")
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def count_items(value: Any) -> int:
    """Number of items, 1 for an object without a length."""
    try:
        return len(value)
    except Exception:
        return 1


def show_value(value: Any) -> str:
    """A value in an error message: one line, not too long, whatever it is."""
    try:
        return put_in_one_line(repr(value))
    except Exception:
        return f"an object of type {type(value).__name__}"


def put_in_one_line(text: str, most: int = SHOWN) -> str:
    """A text without line breaks and control characters, cut after ``most`` characters."""
    line = "".join(sign if sign.isprintable() else "?" for sign in " ".join(text.split()))
    return line if len(line) <= most else f"{line[: most - 3]}..."


@dataclass_transform(frozen_default=True, eq_default=False)
def record(of: type[Record]) -> type[Record]:
    """A dataclass that is compared by identity and never changed. The type checker sees to the latter: at run time the
    check makes constructors take eight times as long."""
    return dataclass(eq=False)(of)


def replace_unchecked(one: Record, **changes: Any) -> Record:
    """`dataclasses.replace` for dataclasses without checks of their own, in a fifth of the time."""
    found, names = object.__new__(type(one)), type(one).__dataclass_fields__  # type: ignore[attr-defined]
    found.__dict__.update({name: value for name, value in one.__dict__.items() if name in names}, **changes)
    return found


MOST_BYTES = 96e6  # of one store
LARGEST_SHARE = 0.4  # of it that one entry may take: larger ones are made anew each time


class Remembered:
    """A store of read-only arrays, the least recently used of which go first; safe in threads."""

    def __init__(self, most_bytes: float = MOST_BYTES) -> None:
        self.most_bytes, self.bytes = most_bytes, 0
        self._entries: OrderedDict[Hashable, tuple[Array, ...]] = OrderedDict()
        self._lock = threading.Lock()

    def find(self, key: Hashable, make: Callable[[], tuple[Array, ...]]) -> tuple[Array, ...]:
        """The arrays of a key, made where they are not there; nobody may change them."""
        with self._lock:
            if key in self._entries:
                self._entries.move_to_end(key)
                return self._entries[key]
        made = make()
        for part in made:
            part.flags.writeable = False
        size = sum(part.nbytes for part in made)
        if size > LARGEST_SHARE * self.most_bytes:
            return made
        with self._lock:
            if key not in self._entries:
                self.bytes += size
            self._entries[key] = made
            while self.bytes > self.most_bytes:
                self.bytes -= sum(part.nbytes for part in self._entries.popitem(last=False)[1])
        return made
