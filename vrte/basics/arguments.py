"""Arguments of public calls, checked by the types that they are declared with, in one place: the front door.

How large a number may be is checked where it is used. What is declared as Any, as cosines are, is checked where it
becomes an array. ``Annotated[kept, taken]`` declares a field that takes more than it keeps.
"""

import functools
import inspect
import itertools
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import FunctionType, ModuleType, NoneType, UnionType
from typing import Annotated, Any, ForwardRef, Literal, TypeVar, Union, get_args, get_origin

import numpy as np

from vrte.basics.arrays import check_numbers, read_real, show_value
from vrte.basics.errors import SceneError

PACKAGE = "vrte."
SHOWN = (NoneType, bool, int, float, complex, str, bytes, list, tuple, dict, set, np.ndarray)
VARIADIC = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
DOUBLE = np.dtype(np.float64)
HINTS = {  # by argument and by the class of what was given in its place
    ("scene", "Layer"): "; vrte.Scene([layer]) makes one of it",
    ("layers", "PhaseMatrix"): "; vrte.Layer(phase_matrix, albedo, thickness) makes one of it",
    ("layers", "Particles"): "; vrte.Layer.of(particles, thickness) makes one of them",
    ("layers", "Lambertian"): "; what lies below is the second argument, base",
    ("phase_matrix", "Particles"): "; vrte.Layer.of(particles, thickness) takes them",
    ("particles", "PhaseMatrix"): "; vrte.Layer(phase_matrix, albedo, thickness) takes it",
    ("base", "float"): "; a base of that albedo is vrte.Lambertian({})",
    ("base", "int"): "; a base of that albedo is vrte.Lambertian({})",
    ("base", "Layer"): "; layers stand in one list, the first argument",
    ("index", "str"): "; vrte.refractive_index({}, wavelength_um).value is that of a material",
}
Call = TypeVar("Call", bound=Callable[..., Any])


@dataclass(frozen=True)
class Kind:
    """Values that a declared type takes, by the ``words`` that name them: those of the types ``at_once``, and those
    that it ``fits``; ``items`` of a list, ``values`` of a dictionary: the kind of each."""

    words: str
    fits: Callable[[Any], bool]
    at_once: frozenset[type] = frozenset()
    items: "Kind | None" = None
    values: "Kind | None" = None

    def takes(self, value: Any) -> bool:
        """Whether a value is of this kind."""
        try:
            return self.fits(value) or type(value) in self.at_once
        except Exception:  # whatever a foreign object raises when it is asked
            return False

    def takes_all(self, values: Iterable[Any]) -> bool:
        """Whether all values are of this kind."""
        return self is ANYTHING or self.at_once.issuperset(map(type, values)) or all(map(self.takes, values))


def is_number(value: Any) -> bool:
    """Whether something is one real number that a float can hold."""
    found = read_real(value)
    return found == found or value != value


def is_array(value: Any) -> bool:
    """Whether something is an array of real numbers, or can become one."""
    if type(value) is np.ndarray and value.dtype is DOUBLE:
        return True
    return check_numbers("array", value).size == np.asarray(value, np.float64).size  # the latter raises for 10**400


def is_list(kind: Kind, value: Any) -> bool:
    """Whether something iterable gives items of a kind; an iterator, which gives them once only, is not asked."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
        return False
    return isinstance(value, Iterator) or kind.takes_all(value)


ANYTHING, NONE = Kind("anything", lambda value: True), Kind("None", lambda value: False, frozenset({NoneType}))
PATH = Kind(
    "the name of a file",
    lambda value: isinstance(value, str | os.PathLike) and bool(os.fspath(value)) and "\0" not in os.fspath(value),
)
KINDS = {
    Any: ANYTHING,
    object: ANYTHING,
    None: NONE,
    NoneType: NONE,
    bool: Kind("True or False", lambda value: False, frozenset({bool, np.bool_})),
    int: Kind("a whole number", lambda value: read_real(value).is_integer(), frozenset({int})),
    float: Kind("a number", is_number, frozenset({float, np.float64})),
    complex: Kind("a number n + ik", lambda value: isinstance(value, complex) or is_number(value), frozenset({float})),
    str: Kind("a text", lambda value: isinstance(value, str), frozenset({str})),
}


@functools.cache
def find_kind(declared: Any) -> Kind:
    """The kind of values that a declared type takes."""
    origin, parts = get_origin(declared), get_args(declared)
    if declared in KINDS:
        return KINDS[declared]
    if origin is Annotated:
        return find_kind(parts[1])
    if origin is os.PathLike:
        return PATH
    if origin is Literal:
        return Kind(" or ".join(map(repr, parts)), lambda value: isinstance(value, str) and value in parts)
    if origin in (Union, UnionType):
        return join_kinds(parts)
    if origin is get_origin(Callable[..., Any]):
        return Kind("a function", callable)
    if origin is np.ndarray:
        return Kind("real numbers", is_array) if parts[1] == np.dtype[np.float64] else ANYTHING
    if isinstance(origin, type) and issubclass(origin, Mapping):
        key, item = map(find_kind, parts)

        def is_table(value: Any) -> bool:
            return isinstance(value, Mapping) and key.takes_all(value) and item.takes_all(value.values())

        return Kind("a dictionary by names", is_table, values=item)
    if origin is tuple and parts[-1] is not Ellipsis:
        kinds = tuple(map(find_kind, parts))

        def is_tuple(value: Any) -> bool:
            return is_list(ANYTHING, value) and all(kind.takes(one) for kind, one in zip(kinds, value, strict=True))

        return Kind(f"({', '.join(kind.words for kind in kinds)})", is_tuple)
    if isinstance(origin, type) and issubclass(origin, Iterable):
        item = find_kind(parts[0])
        return Kind(f"a list (each item {item.words})", functools.partial(is_list, item), items=item)
    if isinstance(declared, str | ForwardRef):  # a class that is not imported where it is named
        name = declared if isinstance(declared, str) else declared.__forward_arg__
        return Kind(f"a {name}", lambda value: name in {one.__name__ for one in type(value).__mro__})
    if not isinstance(declared, type) or getattr(declared, "_is_protocol", False):
        return ANYTHING
    public = getattr(sys.modules.get("vrte"), declared.__name__, None) is declared
    words = f"a {PACKAGE if public else ''}{declared.__name__}"
    return Kind(words, lambda value: isinstance(value, declared), frozenset({declared}))


def join_kinds(parts: Sequence[Any], is_optional: bool = False) -> Kind:
    """The kind of a union: a text among names of files; a default of None is taken and not named."""
    kinds = list(map(find_kind, parts))
    kinds = [kind for kind in kinds if kind is not KINDS[str] or PATH not in kinds]
    *first, last = dict.fromkeys(kind.words for kind in kinds if not (is_optional and kind is NONE and len(kinds) > 1))
    words = f"{', '.join(first)} or {last}" if first else last
    items, values = (next(filter(None, (getattr(kind, name) for kind in kinds)), None) for name in ("items", "values"))
    at_once = frozenset({NoneType} if is_optional else ()).union(*(kind.at_once for kind in kinds))
    others = [kind for kind in kinds if kind is not NONE]
    fits = others[0].fits if len(others) == 1 else lambda value: any(kind.takes(value) for kind in others)
    return Kind(words, fits, at_once, items, values)


def list_kinds(call: Callable[..., Any]) -> dict[str, Kind]:
    """The kinds of a function's parameters by name, in their order."""
    found = {}
    for name, one in inspect.signature(call).parameters.items():
        declared = Any if one.annotation is one.empty or one.kind in VARIADIC else one.annotation
        parts: list[Any] = [declared]
        if isinstance(declared, str):
            parts = declared.split(" | ")
            for index, part in enumerate(parts):  # those that are not imported there stay names
                try:
                    parts[index] = eval(part, sys.modules[call.__module__].__dict__)
                except NameError:
                    parts[index] = part.rpartition(".")[2]
        elif get_origin(declared) in (Union, UnionType):
            parts = list(get_args(declared))
        found[name] = join_kinds(parts, is_optional=one.default is None)
    return found


def check_arguments(call: Call, of: str = "") -> Call:
    """The same function, which raises SceneError for an argument that is not of the type it is declared with; ``of``
    stands before its name in that sentence.

    >>> @check_arguments
    ... def double(x: float) -> float:
    ...     return 2.0 * x
    >>> double(2.0)
    4.0
    >>> double(x="2")
    Traceback (most recent call last):
    vrte.SceneError: x must be a number, not '2'
    """
    kinds: dict[str, Kind] = {}  # found at the first call: most are never made
    names = call.__code__.co_varnames[: call.__code__.co_argcount]

    @functools.wraps(call)
    def checked(*given: Any, **named: Any) -> Any:
        if not kinds:
            kinds.update(list_kinds(call))
        for name, value in itertools.chain(zip(names, given, strict=False), named.items()):
            kind = kinds.get(name, ANYTHING)
            if type(value) not in kind.at_once and not kind.takes(value):
                raise describe_refusal(of, name, kind, value)
        return call(*given, **named)

    return checked  # type: ignore[return-value]


def describe_refusal(of: str, name: str, kind: Kind, value: Any) -> SceneError:
    """What is wrong with an argument, or with the first item in it that is, in a sentence."""
    alone = ""
    if kind.items is not None and isinstance(value, list | tuple):
        parts = [(f"item {index} of {name}", kind.items, item) for index, item in enumerate(value, 1)]
    elif kind.values is not None and isinstance(value, Mapping):
        parts = [(f"{name}: {key}", kind.values, item) for key, item in value.items() if isinstance(key, str)]
    else:
        parts = []
        if kind.items is not None and kind.items.takes(value):
            alone = f"; one alone is [{show_value(value)}]"
    where, kind, value = next((part for part in parts if not part[1].takes(part[2])), (name, kind, value))
    words = kind.words.replace("a number", "a real number") if isinstance(value, complex) else kind.words
    return SceneError(f"{of}{where} must be {words}, not {show_given(name, value)}{alone}", name)


def show_given(name: str, value: Any) -> str:
    """What was given in place of an argument, and what makes the right thing of it, where that is known."""
    shown = show_value(value) if type(value) in SHOWN else f"an object of type {type(value).__name__}"
    if isinstance(value, type | FunctionType):
        shown = f"{value.__name__} itself, which has to be called: {value.__name__}(...)"
    return shown + HINTS.get((name, type(value).__name__), "").format(shown)


def open_front_door(module: ModuleType, names: Iterable[str], inner: Iterable[str] = ()) -> None:
    """Checks arguments of a module's functions, classes and modules of these names; ``inner``: methods left out."""
    for name in names:
        given = getattr(module, name)
        if isinstance(given, ModuleType):
            made = {key: one for key, one in vars(given).items() if isinstance(one, FunctionType) and key[0] != "_"}
            open_front_door(given, [key for key, one in made.items() if one.__module__ == given.__name__])
        elif isinstance(given, type):
            for one in given.__mro__:
                for key, method in list(vars(one).items()) if one.__module__.startswith(PACKAGE) else ():
                    call = method.__func__ if isinstance(method, classmethod | staticmethod) else method
                    if not isinstance(call, FunctionType) or hasattr(call, "__wrapped__") or key in {*inner}:
                        continue
                    if not key.startswith("_") or key in ("__init__", "__call__", "__getitem__"):
                        checked = check_arguments(call, f"{one.__name__}: " if key == "__init__" else "")
                        setattr(one, key, checked if call is method else type(method)(checked))
        elif inspect.signature(given).parameters:
            checked = check_arguments(given)
            setattr(module, name, checked)
            setattr(sys.modules[given.__module__], given.__name__, checked)  # where pickles look for it
