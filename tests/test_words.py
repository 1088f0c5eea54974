"""Names and first lines: functions are verb + noun, docstrings say at once what something is to a physicist."""

import ast
import inspect
from pathlib import Path

import pytest

import vrte
from vrte.app import figures

PACKAGE = Path(vrte.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
# what a user calls bears the field's name for what it returns
NAMED_AFTER_RESULTS = {*vrte.__all__, *dir(vrte.quantities), *dir(vrte.over_hemisphere), *dir(figures)}
# and so do those that the documents name, entry points, and a stage that has the core's own name
KNOWN_BY_NAME = {
    "main",
    "to_xarray",
    "azimuthal_sum",
    "held_out",
    "dask_setup",
    "propagator",
    "devices",
    "session",
    "directions",
}
VERBS = set(
    """
    add adopt advise answer arrange assemble assign average balance begin bind bound build calibrate carry catch
    change check choose clear collect colour combine compare complain compute connect convert copy count create cut
    deepen define describe develop differentiate discretise divide double download draw drop encode end estimate
    evaluate examine expand explain extend fetch fill find finish fit fix flatten flush fold follow foretell forget
    format freeze gather get group grow guard guess halve has hash hide identify import integrate interleave
    interpolate invert is iterate join judge keep label launch lay leave let light limit linearize list load locate
    lock look make mark mask measure merge mirror mix move multiply name note number open order own pack pad pair
    parse pass perform pick place plan plot predict prepare print project pull put query quote raise rank read receive
    reconstruct record recover reduce refine reflect refract refresh remove rename repair repeat replace report
    require respond restore resume round run sample save say scale scatter seal select send serve set settle shade
    shape share shorten show solve sort split spread stack stand start step store stretch suggest sum sweep
    tabulate take tell time translate transmit trim truncate try turn unpack upload vary verify view wait want warn
    weigh wrap write
    """.split()  # noqa: SIM905
)


def functions(path: Path) -> list[ast.FunctionDef]:
    return [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_functions_begin_with_a_verb(path: Path) -> None:
    names = {function.name for function in functions(path)} - NAMED_AFTER_RESULTS - KNOWN_BY_NAME
    assert not {name for name in names if name.strip("_").split("_")[0] not in VERBS}


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_first_lines_are_no_riddles(path: Path) -> None:
    """Three words at least, and nothing that only points: what it takes, the same, as above."""
    for function in functions(path):
        if first := (ast.get_docstring(function) or "").partition("\n")[0]:
            assert len(first.split()) >= 3, f"{function.name}: {first}"


@pytest.mark.parametrize("name", [name for name in vrte.__all__ if inspect.isfunction(getattr(vrte, name))])
def test_public_calls_say_what_they_take_return_and_raise(name: str) -> None:
    """Numpydoc sections, every parameter among them, and an example."""
    call = getattr(vrte, name)
    said = inspect.getdoc(call) or ""
    parameters = inspect.signature(call).parameters
    assert "\nReturns\n-------\n" in said
    assert ">>> " in said
    if parameters:
        assert "\nParameters\n----------\n" in said
        _, _, listed = said.partition("\nParameters\n----------\n")
        listed = listed.partition("\nReturns\n")[0]
        for parameter in parameters:
            assert any(
                parameter in line.partition(" : ")[0].replace("*", "").split(", ") for line in listed.splitlines()
            )
