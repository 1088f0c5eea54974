"""The API reference: what stands on its pages is said the numpydoc way, and every public name stands on one of them."""

import ast
import builtins
import inspect
import re
from collections.abc import Iterator
from doctest import DocTestParser
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from griffe import Docstring

import vrte
from vrte import _core

ROOT = Path(vrte.__file__).parents[1]
PAGES = sorted((ROOT / "docs/reference/api").glob("*.md"))
LISTED = [name for page in PAGES for name in re.findall(r"^::: (\S+)", page.read_text("utf-8"), re.MULTILINE)]
FIXTURES = "brdf", "painted", "fitted", "matched"  # of conftest.py; the pages say what they are
PROPERTIES = property | cached_property
STUB = ast.parse((ROOT / "vrte/_core.pyi").read_text("utf-8"))
CORE = "vrte._core."  # compiled: its signatures are in the stub


def find_object(name: str) -> Any:
    module, _, last = name.rpartition(".")
    return getattr(import_module(module), last)


def list_members(name: str, given: Any) -> Iterator[tuple[str, Any]]:
    """What is listed, with the public methods and properties of a class, or the functions of a module."""
    yield name, given
    for owner in inspect.getmro(given) if inspect.isclass(given) else [given] if inspect.ismodule(given) else []:
        where = owner.__name__ if inspect.ismodule(owner) else owner.__module__
        for member, value in vars(owner).items():
            value = getattr(value, "__func__", value)  # of a class method
            made_here = inspect.isclass(owner) or getattr(value, "__module__", "") == where
            ours = isinstance(value, PROPERTIES) or (inspect.isfunction(value) and made_here)
            # a method that says nothing itself means what a class above says of it
            speaks = value.__doc__ or not inspect.getdoc(getattr(owner, member))
            if ours and where.startswith("vrte") and member[0] != "_" and speaks:
                yield f"{name}.{member}", value


DOCUMENTED = dict(
    pair for name in LISTED if not name.startswith(CORE) for pair in list_members(name, find_object(name))
)
PUBLIC = [getattr(vrte, name) for name in vrte.__all__]  # numpydoc sections; all else is one sentence or two


def read_sections(words: str) -> dict[str, Any]:
    return {section.kind.value: section.value for section in Docstring(words).parse("numpy", warnings=False)}


def find_unknown_names(words: str) -> set[str]:
    """Names that an example uses and does not make or import: who copies it has none of them."""
    nodes = list(ast.walk(ast.parse("".join(example.source for example in DocTestParser().get_examples(words)))))
    names = [node for node in nodes if isinstance(node, ast.Name)]
    made = {node.id for node in names if isinstance(node.ctx, ast.Store)} | {*dir(builtins), *FIXTURES}
    made |= {node.arg for node in nodes if isinstance(node, ast.arg)}
    made |= {node.name for node in nodes if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.ExceptHandler)}
    made |= {(node.asname or node.name).split(".")[0] for node in nodes if isinstance(node, ast.alias)}
    return {node.id for node in names} - made


def find_faults(given: Any, words: str) -> list[str]:
    """What the docstring of a function, class, property or module lacks, or has too much."""
    first, _, rest = words.partition("\n")
    faults = []
    if len(first.split()) < 3 or not first.endswith(".") or len(first) > 120 or (rest and not rest.startswith("\n")):
        faults.append(f"first line: {first!r}")
    if re.search(r"^(Source|Parameters|Returns): |\bRaises [A-Z]\w+(Error|Warning)\b", words, re.MULTILINE):
        faults.append("a section within the text")
    sections = read_sections(words)
    if "examples" not in sections and ">>> " in words:
        faults.append("an example outside of Examples")
    faults += [f"not imported: {name}" for name in sorted(find_unknown_names(words))]
    if isinstance(given, ModuleType | PROPERTIES):
        return faults
    is_error = inspect.isclass(given) and issubclass(given, BaseException)
    if ">>> " not in words and not is_error:
        faults.append("no example")
    reported = {one.name: one for kind in ("parameters", "attributes") for one in sections.get(kind, [])}
    taken = {} if is_error and "__init__" not in vars(given) else dict(inspect.signature(given).parameters)
    taken.pop("self", None), taken.pop("cls", None)
    stars = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}
    names = {stars.get(one.kind, "") + name for name, one in taken.items()}
    own = {*dir(given), *given.__annotations__}
    faults += [f"not said: {name}" for name in sorted(names - reported.keys())]
    faults += [f"no such parameter: {name}" for name in sorted(reported.keys() - names - own)]
    explained = [
        *reported.values(),
        *(one for kind in ("returns", "raises", "warns") for one in sections.get(kind, [])),
    ]
    faults += [f"nothing said of {one.annotation}" for one in explained if not one.description.strip()]
    if inspect.isfunction(given) and given.__annotations__.get("return") not in (None, "None"):
        faults += [] if "returns" in sections else ["no Returns"]
    return faults


def test_docstrings() -> None:
    faults = {}
    for name, given in DOCUMENTED.items():
        words = inspect.getdoc(given) or ""
        is_public = any(given is one for one in PUBLIC)
        found = find_faults(given, words) if is_public else ["too short"] if len(words.split()) < 3 else []
        faults |= {name: found} if found else {}
    assert faults == {}


@pytest.mark.parametrize("name", [name.rpartition(".")[2] for name in LISTED if name.startswith(CORE)])
def test_docstring_of_the_core(name: str) -> None:
    words = inspect.getdoc(getattr(_core, name)) or ""
    reported = read_sections(words)
    (taken,) = (one for one in ast.walk(STUB) if isinstance(one, ast.FunctionDef) and one.name == name)
    names = {each.arg for each in (*taken.args.args, *taken.args.kwonlyargs)}
    assert {one.name for one in reported["parameters"]} == names - {"self"}
    assert "returns" in reported or "out" in names
    assert not find_unknown_names(words)


def test_every_public_name_stands_on_one_page() -> None:
    index = (ROOT / "docs/reference/api/index.md").read_text("utf-8")
    objects = [find_object(name) for name in LISTED if not name.startswith(CORE)]
    for name in vrte.__all__:
        assert sum(one is getattr(vrte, name) for one in objects) == 1, name
        assert f"[{name}][vrte." in index, name
    assert len(LISTED) == len(set(LISTED))
