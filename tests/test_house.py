"""The plan of the house: what may import what, and the one door upward. `make lint` has import-linter for the rest."""

import ast
import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import vrte
from bench.faults import FAULTS, ROOT, Fault
from vrte.basics.views import VIEWS, view
from vrte.cl.session import SHARED

PACKAGE = Path(vrte.__file__).parent
HOUSE = (ROOT / "docs" / "explanation" / "house.md").read_text()
CLASSES = {
    **{name: getattr(vrte, name) for name in vrte.__all__},
    **vars(import_module("vrte.optics.phase_matrix")),
    **vars(import_module("vrte.results.result")),
    **vars(import_module("vrte.appearance.hiding")),
    **vars(import_module("vrte.appearance.two_flux_fit")),
}


def test_only_the_package_itself_is_loose() -> None:
    """Every module but the door, the command and the core lies in a folder."""
    assert {path.name for path in PACKAGE.glob("*.py")} == {"__init__.py", "cli.py"}


def test_of_the_package_itself_only_core_and_version_are_imported() -> None:
    """import-linter takes `from vrte import _core` for an import of all of vrte, and is told to let that pass."""
    for path in PACKAGE.rglob("*.py"):
        if path.parent == PACKAGE:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module == "vrte":
                names = {alias.name for alias in node.names}
                assert names <= {"_core", "__version__"} or all((PACKAGE / name).is_dir() for name in names), path


def count_lines(room: str) -> int:
    """Lines of a room of docs/explanation/house.md."""
    if room == "top":
        files = [path for path in PACKAGE.iterdir() if path.is_file()]
    else:
        above = ROOT if room in ("tests", "bench") else PACKAGE
        files = [path for folder in room.split(", ") for path in (above / folder).rglob("*")]
    endings = {".py", ".pyx", ".pxi", ".pyi", ".h", ".cl"}
    return sum(len(path.read_text().splitlines()) for path in files if path.suffix in endings)


BUDGETS = re.findall(r"^\| ([\w, ]+) \| ([\d,]+) \| [\d,]+ \|", HOUSE, re.MULTILINE)


def test_every_room_has_a_budget() -> None:
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir() and any(path.rglob("*.py"))}
    folders = {name for name in folders if any(path.stat().st_size for path in (PACKAGE / name).rglob("*.py"))}
    rooms = {name for room, _ in BUDGETS for name in room.split(", ")}
    assert folders | {"core", "top", "tests", "bench"} == rooms


@pytest.mark.parametrize(("room", "budget"), BUDGETS)
def test_rooms_keep_their_budgets(room: str, budget: str) -> None:
    assert 0 < count_lines(room) <= int(budget.replace(",", "")), "say why in docs/explanation/house.md"


def test_the_core_has_a_file_a_stage() -> None:
    """_core.pyx is the table of contents: every file of core/ is included once, and none has a long line; nor has a
    header of core/kernels/, all of which the core and the OpenCL kernels have."""
    contents = (PACKAGE / "_core.pyx").read_text()
    assert len(contents.splitlines()) <= 80
    files = sorted((PACKAGE / "core").iterdir())
    included = re.findall(r'^include "core/(\w+\.pxi)"$', contents, re.MULTILINE)
    assert sorted(included) == [path.name for path in files if path.suffix == ".pxi"]
    others = {path.name for path in files if path.suffix not in (".pxi", ".h")}
    assert others - {"__pycache__"} == {"declare.py", "stages.toml", "kernels"}
    shared = sorted((PACKAGE / "core" / "kernels").iterdir())
    listed = re.findall(r'^#include "(\w+)\.h"$', (shared[0].parent / "in_c.h").read_text(), re.MULTILINE)
    assert tuple(listed) == SHARED
    assert sorted(f"{name}.h" for name in (*listed, "in_c")) == [path.name for path in shared]
    assert not [
        path.name
        for path in [*files, *shared]
        if path.is_file() and any(len(line) > 120 for line in path.read_text().splitlines())
    ]


@pytest.mark.parametrize("row", VIEWS, ids=".".join)
def test_every_view_is_there_and_takes_what_its_method_takes(row: tuple[str, str]) -> None:
    """The function of a row has the parameters of the method that calls it."""
    kind, verb = row
    module, name = VIEWS[row].split(":")
    function = getattr(import_module(module), name)
    asked = list(inspect.signature(getattr(CLASSES[kind], verb)).parameters.values())
    taken = list(inspect.signature(function).parameters.values())
    assert len(taken) >= len(asked)
    assert all(more.default is not inspect.Parameter.empty for more in taken[len(asked) :])
    assert [each.name for each in asked[1:]] == [each.name for each in taken[1 : len(asked)]]


def test_a_view_of_ones_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """A third party's row takes the place of ours, for classes made from ours as well."""
    monkeypatch.setitem(VIEWS, ("PhaseMatrix", "plot"), "builtins:repr")
    matrix: Any = vrte.isotropic()
    assert matrix.plot() == repr(matrix)
    with pytest.raises(LookupError, match=r"int has no view 'plot'.*VIEWS"):
        view(1, "plot")


def test_nobody_asks_for_the_class_of_a_boundary() -> None:
    """Outside vrte/scene a boundary is asked what it does; only who makes one, or shows it, knows its class."""
    bases = {"Boundary", "Lambertian", "MuellerBase"}
    for path in PACKAGE.rglob("*.py"):
        if path.parent.name == "scene":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "isinstance":
                assert not bases & {each.id for each in ast.walk(node.args[1]) if isinstance(each, ast.Name)}, path


@pytest.mark.parametrize("work", ["import vrte", "from vrte.cli import main; main(['--help'])"])
def test_few_modules_load_at_first(work: str) -> None:
    """120 modules of vrte at most, and 0.25 s of processor time beside NumPy and SciPy; no heavy library."""
    lines = [
        "import argparse, importlib.metadata, sys, time, numpy, scipy.linalg",
        "begin = time.process_time()",
        f"try:\n    {work}\nexcept SystemExit: pass",
        "seconds = time.process_time() - begin",
        "modules = [name for name in sys.modules if name.split('.')[0] == 'vrte']",
        "heavy = {'xarray', 'matplotlib', 'rich', 'scipy.optimize', 'scipy.interpolate'} & {*sys.modules}",
        "print(); print(len(modules), seconds, len(heavy))",
    ]
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=True)
    modules, seconds, heavy = done.stdout.splitlines()[-1].split()
    assert int(modules) <= 120
    assert float(seconds) <= 0.25
    assert int(heavy) == 0


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_faults_can_still_be_planted(fault: Fault) -> None:
    """Each old text of the table of bench/faults.py stands once in its file, and the tests that it names are there."""
    assert (ROOT / "vrte" / fault.file).read_text().count(fault.old) == 1
    assert all((ROOT / "tests" / f"test_{name}.py").is_file() for name in fault.tests.split())


def test_all_public_names_are_listed_and_only_they() -> None:
    assert {*vrte.__all__} <= {*dir(vrte)}
    assert list(vrte.__all__) == sorted(vrte.__all__)
    with pytest.raises(AttributeError, match="no attribute 'brdff'"):
        _ = vrte.brdff  # type: ignore[attr-defined]
    import_module("vrte.fit")  # a folder of the same name does not take the place of the call
    assert inspect.isfunction(vrte.fit)
