"""Polarized subsurface reflectance of particulate layers: the public names, each loaded when it is first asked for.

`__init__.pyi` lists them, for type checkers, for editors and for this module.
"""

from vrte.basics import starting  # noqa: F401  # first of all: Ctrl-C while the rest loads

# isort: split
import ast as _ast
import sys as _sys
from importlib import import_module as _import_module
from pathlib import Path as _Path
from types import ModuleType as _ModuleType
from typing import Any as _Any

from vrte.basics.starting import wait_passively as _wait_passively

try:
    with _wait_passively():
        import vrte._core  # noqa: F401
except ModuleNotFoundError as error:
    if error.name != "vrte._core":
        raise
    raise ImportError(
        f"{_Path(__file__).parent} holds vrte's sources without their compiled core: start Python in another folder to "
        "use the vrte that is installed, or build it here by 'make env' or 'pip install --editable .'"
    ) from None

from vrte.basics.arguments import open_front_door as _open_front_door

_INNER = (
    "quadrature",
    "compute_elements",
    "compute_f",
    "compute_phase_function",
    "weigh",
    "with_late_diagnostics",
)  # while solving
_lines = _ast.parse(_Path(__file__).with_suffix(".pyi").read_text("utf-8")).body
_MODULES: dict[str, tuple[str, str]] = {  # of each public name: the module and the name there
    alias.asname or alias.name: (str(line.module), alias.name)
    for line in _lines
    if isinstance(line, _ast.ImportFrom)
    for alias in line.names
}
for _line in _lines:
    match _line:
        case _ast.Assign([_ast.Name(_new)], _ast.Name(_old)):  # a public name that differs from that in its module
            _MODULES[_new] = _MODULES.pop(_old)
__all__ = sorted(_MODULES)
_opened: set[str] = set()  # public names whose arguments are checked


def _find_version() -> str:
    from importlib import metadata

    try:
        return metadata.version("vrte")
    except metadata.PackageNotFoundError:  # built in place and never installed
        return "0+unknown"


def __getattr__(name: str) -> _Any:
    """Loads a public name; from then on the arguments of all public names that are loaded are checked."""
    if name == "__version__":
        return globals().setdefault(name, _find_version())
    if name not in _MODULES:
        raise AttributeError(f"module 'vrte' has no attribute {name!r}")
    _load(*_MODULES[name])
    for public, (module, own) in _MODULES.items():
        if public not in _opened and (module in _sys.modules or public == name):
            _open(public, _load(module, own))
    return globals()[name]


def _load(module: str, name: str) -> _Any:
    found = _import_module(module)
    return getattr(found, name) if hasattr(found, name) else _import_module(f"{module}.{name}")


def _open(name: str, given: _Any) -> None:
    globals()[name] = given
    bases = _sys.modules.get("vrte.scene.boundary")
    _open_front_door(_sys.modules[__name__], [name], inner=[*(vars(bases.Boundary) if bases else ()), *_INNER])
    _opened.add(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(_ModuleType):
    def __setattr__(self, name: str, value: _Any) -> None:
        if not (isinstance(value, _ModuleType) and name in _MODULES and value.__name__ == f"vrte.{name}"):
            super().__setattr__(name, value)  # the call vrte.fit is not replaced by the folder vrte/fit


_sys.modules[__name__].__class__ = _Package
