"""The compiled core's signatures: what _core.pyi says is what is compiled, and its types tell arguments apart."""

import ast
import inspect
from pathlib import Path

from vrte import _core

ROOT = Path(__file__).parents[1]
STUB = list(ast.walk(ast.parse((ROOT / "vrte" / "_core.pyi").read_text())))
DECLARED = {node.name: node.args for node in STUB if isinstance(node, ast.FunctionDef)}
FIELDS: dict[str, set[str]] = {}  # of classes of arguments that several functions share
for node in STUB:
    if isinstance(node, ast.ClassDef):
        above = set().union(*(FIELDS.get(base.id, set()) for base in node.bases if isinstance(base, ast.Name)))
        FIELDS[node.name] = above | {ast.unparse(one.target) for one in node.body if isinstance(one, ast.AnnAssign)}


def test_what_is_declared_is_what_is_compiled() -> None:
    for name, args in DECLARED.items():
        shared = FIELDS[args.kwarg.annotation.slice.id] if args.kwarg else set()  # type: ignore[union-attr]
        compiled = inspect.signature(getattr(_core, name)).parameters.values()
        in_order = [each.name for each in compiled if each.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD]
        named = {each.name for each in compiled if each.kind is inspect.Parameter.KEYWORD_ONLY}
        assert in_order == [arg.arg for arg in args.args if arg.arg != "self"], name
        assert named == {arg.arg for arg in args.kwonlyargs} | shared, name


def test_types_tell_arguments_apart() -> None:
    """None is left open: mypy finds arrays of numbers in the place of whole numbers, and arrays in that of numbers."""
    for name, args in DECLARED.items():
        for arg in (*args.args, *args.kwonlyargs):
            if arg.arg != "self":
                assert arg.annotation is not None, f"{name}: {arg.arg}"
                assert ast.unparse(arg.annotation) not in ("Any", "object"), f"{name}: {arg.arg}"
    types = {arg.arg: ast.unparse(arg.annotation) for arg in DECLARED["assemble"].kwonlyargs if arg.annotation}
    assert (types["terms"], types["albedo"], types["n_out"]) == ("IntArray", "Array", "int")
