"""How something is solved: every option once, with its default, its check, and the words that users read of it.

The calls, sweeps, scene files and the command line all take their options from here. A backend is which kernels do the
work, and which linear algebra: Table 1 of the GPU paper, and its six configurations, are made of these.
"""

import math
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from functools import lru_cache
from pathlib import Path
from textwrap import fill, indent
from typing import Any, TypeVar

from vrte.basics import cost
from vrte.basics.arrays import check_choice, check_flag, check_number, check_whole, show_value
from vrte.basics.errors import SceneError
from vrte.optics.truncation import CHOICES
from vrte.scene.illumination import SIDES


class Backend(Enum):
    """Where stages run: ``kernels`` "sequential", "openmp" or "opencl"; linear algebra by LAPACK or the device."""

    OPENMP = "openmp", "openmp", "lapack"
    SEQUENTIAL = "sequential", "sequential", "lapack"
    SEQUENTIAL_DEVICE = "sequential+device", "sequential", "device"
    OPENCL_LAPACK = "opencl+lapack", "opencl", "lapack"
    OPENCL = "opencl", "opencl", "device"

    def __init__(self, label: str, kernels: str, linear_algebra: str) -> None:
        self.label, self.kernels, self.linear_algebra = label, kernels, linear_algebra
        self.needs_device = kernels == "opencl" or linear_algebra == "device"


_BY_LABEL = {backend.label: backend for backend in Backend}
BACKENDS = tuple(_BY_LABEL)


EXACT = "discrete-ordinates"
AUTO = "auto"  # one of the methods, by the rules of vrte/methods/parts/auto.py
_TABLES = tomllib.loads(Path(__file__).with_name("options.toml").read_text("utf-8"))
_METHODS = Path(__file__).parents[1] / "methods" / "methods.toml"  # a table a method
METHODS = (EXACT, *sorted(tomllib.loads(_METHODS.read_text("utf-8")).keys() - {EXACT}))
METHOD_NAMES = (*METHODS, AUTO)  # that can be asked for
ALGORITHMS = ("auto", "direct", "modes", "doubling", "invariance")
BY_RULE = ("auto", "direct")  # direct: auto's rule without what iterates to a tolerance
MOST_NODES, MOST_THREADS, MOST_GRADING = 4096, 4096, 3
FINEST, COARSEST = 1e-15, 0.1  # accuracy that can be asked for
WITH_NODES, WITHOUT_NODES = 1e-8, 1e-6  # what it is by default
PRECISIONS = ("auto", "double", "single")  # of an OpenCL device
OF_SINGLE = 1e-4  # accuracy that single precision is good for, and what it is by default there
# options of which each method says whether it uses them
NOT_FOR_ALL = ("nodes", "grading", "accuracy", "algorithm", "verify", "truncation", "backend", "precision")
Call = TypeVar("Call", bound=Callable[..., Any])


@dataclass(frozen=True)
class Option:
    """An option as users meet it: default, type ``of`` it, ``check`` of its name and value, ``allowed`` in words, its
    line ``short`` on the command line, what docstrings say ``more``, and its ``choices``."""

    default: Any
    of: type
    check: Callable[[str, Any], Any]
    allowed: str
    short: str
    more: str = ""
    choices: tuple[str, ...] = ()

    def described(self, name: str) -> str:
        """Its entry among the parameters of a docstring, as numpydoc writes it."""
        kind = f"{{{', '.join(map(repr, self.choices))}}}" if self.choices else self.of.__name__
        return describe(f"{name} : {kind}, optional", f"{self.short[0].upper()}{self.short[1:]}{self.more}.")


def check_settings(name: str, value: Any) -> dict[str, Any]:
    """The settings of a method, by name."""
    if not (isinstance(value, Mapping) and all(isinstance(key, str) for key in value)):
        raise SceneError.of(name, f"must be a dictionary by names of settings, not {show_value(value)}")
    return dict(value)


PHOTONS = "photons"  # what verify can be beside true and false


def check_verify(name: str, value: Any) -> Any:
    """Whether to verify, or by photons."""
    if isinstance(value, str) and value == PHOTONS:
        return value
    return check_flag(name, value, f"True or False or {PHOTONS!r}")


def make_option(
    name: str, default: Any, of: type, check: Callable[[str, Any], Any], allowed: str, choices: tuple[str, ...] = ()
) -> Any:
    """A field of `How` with its `Option`, in the words of options.toml."""
    words = {part: text.format_map(globals()) for part, text in _TABLES["options"][name].items()}
    return field(default=None, metadata={"option": Option(default, of, check, allowed, choices=choices, **words)})


def make_choice_option(name: str, default: str, choices: tuple[str, ...]) -> Any:
    """The same for one of some names."""
    allowed = " or ".join(f'"{choice}"' for choice in choices)
    return make_option(name, default, str, lambda key, value: check_choice(key, value, choices), allowed, choices)


def make_number_option(name: str, most: int) -> Any:
    """The same for a whole number from 1 on, None where vrte finds it."""
    allowed = f"a whole number from 1 to {most}"
    return make_option(name, None, int, lambda key, value: check_whole(key, value, 1, most), allowed)


@dataclass(frozen=True, eq=False)
class How:
    """All options of a call, checked, None where left out, in the order of `vrte.brdf`; ``given``: those of NOT_FOR_ALL
    that the user gave. Raises SceneError naming the option, TypeError for one that there is not."""

    algorithm: str = make_choice_option("algorithm", "auto", ALGORITHMS)
    verify: bool = make_option("verify", False, bool, check_verify, 'true, false or "photons"')
    accuracy: float = make_option(
        "accuracy",
        None,
        float,
        lambda name, value: check_number(name, value, FINEST, COARSEST, f"between {FINEST:g} and {COARSEST:g}"),
        f"a number between {FINEST:g} and {COARSEST:g}",
    )
    truncation: str = make_choice_option("truncation", "auto", CHOICES)
    backend: Backend = make_option(  # noqa: RUF009
        "backend",
        "openmp",
        str,
        lambda name, value: value if isinstance(value, Backend) else _BY_LABEL[check_choice(name, value, BACKENDS)],
        "",
        BACKENDS,
    )
    method: str = make_choice_option("method", EXACT, METHOD_NAMES)
    settings: Mapping[str, Any] = make_option(
        "settings", {}, dict, check_settings, "a table of the method's settings by name"
    )
    illuminate: str = make_choice_option("illuminate", "top", SIDES)
    time_limit_s: float = make_option(
        "time_limit_s",
        cost.TIME_LIMIT_S,
        float,
        lambda name, value: check_number(name, value, 0.0, math.inf, "seconds"),
        "seconds above 0, inf for no limit",
    )
    precision: str = make_choice_option("precision", "auto", PRECISIONS)
    nodes: int | None = make_number_option("nodes", MOST_NODES)
    grading: int | None = make_number_option("grading", MOST_GRADING)
    threads: int | None = make_number_option("threads", MOST_THREADS)
    given: Any = None  # frozenset of names
    by_photons: bool = False  # verify="photons", which every method takes; verify is False then

    def __post_init__(self) -> None:
        if self.verify == PHOTONS:
            vars(self).update(verify=False, by_photons=True)
        left_out = {name for name in OPTIONS if (value := getattr(self, name)) is None or value is False}
        found: dict[str, Any] = {"given": frozenset(NOT_FOR_ALL) - left_out} if self.given is None else {}
        for name, known in OPTIONS.items():
            value = getattr(self, name)
            value = known.default if value is None else value
            found[name] = None if value is None else known.check(name, value)
        if self.accuracy is None:
            usual = WITHOUT_NODES if self.nodes is None else WITH_NODES
            found["accuracy"] = OF_SINGLE if found["precision"] == "single" else usual
        for name, value in found.items():
            object.__setattr__(self, name, value)
        self.check_together()

    def check_together(self) -> None:
        """Whether the options go together, whatever the scene. Raises SceneError."""
        if self.settings and self.method == EXACT:
            words = "has no settings: it is set by nodes, accuracy, algorithm and truncation"
            raise SceneError(f"method {EXACT!r} {words}", "method")
        if self.method == AUTO and (self.settings or self.nodes is not None or self.grading is not None):
            name = "settings" if self.settings else "grading" if self.nodes is None else "nodes"
            words = f"takes no {name}: it goes by accuracy; for {name} name the method"
            raise SceneError(f"method {AUTO!r} {words}", "method")
        if self.precision != "auto" and self.backend is not Backend.OPENCL:
            words = f"is of backend 'opencl' alone: {self.backend.label!r} computes in doubles"
            raise SceneError(f"precision {self.precision!r} {words}", "precision")
        if self.precision == "single" and self.accuracy < OF_SINGLE:
            words = f"is good for an accuracy of {OF_SINGLE:g} and coarser, not {self.accuracy:g}"
            raise SceneError(f"precision 'single' {words}", "precision")
        if (self.grading or 1) > 1 and self.backend is Backend.OPENCL:
            raise SceneError(f"grading {self.grading} is not for backend 'opencl': leave it out", "grading")
        if self.algorithm == "modes" and self.backend.linear_algebra == "device":
            raise SceneError(
                f"algorithm 'modes' needs an eigensolver, which backend {self.backend.label!r} does not have: "
                "ask for algorithm 'auto', 'direct', 'doubling' or 'invariance', or for another backend",
                "algorithm",
            )


def check_options(*options: Any, **more: Any) -> How:
    """All options of a call, checked once where the same ones come again."""
    try:
        return keep_options(*options, **more)
    except TypeError:  # something that has no hash, or an option that there is not
        return How(*options, **more)


keep_options = lru_cache(maxsize=64, typed=True)(How)
OPTIONS: dict[str, Option] = {one.name: one.metadata["option"] for one in fields(How) if one.metadata}
WORDS: dict[str, list[str]] = _TABLES["words"]  # of parameters of public calls that are no options, and what they raise


def complete_docstring(call: Call) -> Call:
    """Puts entries of numpydoc in place of lines {name, name}: {all} parameters of the call, or all {options}."""
    names = call.__code__.co_varnames[: call.__code__.co_argcount]
    several = {"all": names, "options": tuple(name for name in names if name in OPTIONS)}

    def write(found: re.Match[str]) -> str:
        names = [one for name in found[1].split(", ") for one in several.get(name, (name,))]
        entries = [OPTIONS[name].described(name) if name in OPTIONS else describe(*WORDS[name]) for name in names]
        return indent("\n".join(entries), "    ")

    if call.__doc__:  # nothing is left of it where Python runs with -OO
        call.__doc__ = re.sub(r"^    \{([\w, ]+)\}$", write, call.__doc__, flags=re.MULTILINE)
    return call


def describe(heading: str, words: str) -> str:
    """An entry of a numpydoc section: its heading, and its words indented below."""
    return f"{heading}\n{indent(fill(words, 108), '    ')}"
