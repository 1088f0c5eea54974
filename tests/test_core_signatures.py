"""The compiled core's signatures: what _core.pyi says is what is compiled, and mypy finds a swapped argument."""

import ast
import inspect
import os
import re
import subprocess
import sys
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
CALL = (
    "_core.order_bounds(crew, coefficients=a, terms=i, albedo=a, directions=a, n_node=1, n_out=1, strength=a, bounds=a)"
)
MISTAKES = [  # what is written instead of what, and what mypy says of it
    ("terms=i, albedo=a", "terms=a, albedo=i", 'Argument "terms" has incompatible type'),
    ("n_out=1, strength=a", "n_out=a, strength=1", 'Argument "n_out" has incompatible type'),
    ("coefficients=a, terms=i", "a, i", "Too many positional arguments"),
    ("n_node=1, ", "", 'Missing named argument "n_node"'),
    ("bounds=a", "bound=a", 'Unexpected keyword argument "bound"'),
]


def test_what_is_declared_is_what_is_compiled() -> None:
    for name, args in DECLARED.items():
        shared = FIELDS[args.kwarg.annotation.slice.id] if args.kwarg else set()  # type: ignore[union-attr]
        compiled = inspect.signature(getattr(_core, name)).parameters.values()
        in_order = [each.name for each in compiled if each.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD]
        named = {each.name for each in compiled if each.kind is inspect.Parameter.KEYWORD_ONLY}
        assert in_order == [arg.arg for arg in args.args if arg.arg != "self"], name
        assert named == {arg.arg for arg in args.kwonlyargs} | shared, name


def test_mypy_finds_a_swapped_argument(tmp_path: Path) -> None:
    """Each mistake in a line of its own; the call without one passes."""
    setup = "import numpy as np\nfrom vrte import _core\nfrom vrte.basics.running import ThreadTeam\n"
    setup += "a, i = np.zeros(1), np.zeros(1, np.int32)\ncrew = ThreadTeam(1, a, i)\n"
    wrong = [CALL.replace(right, instead) for right, instead, _ in MISTAKES]
    assert CALL not in wrong
    (tmp_path / "calls.py").write_text("\n".join([setup + CALL, *wrong]) + "\n")
    command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), "calls.py"]
    command += ["--cache-dir", str(ROOT / ".mypy_cache")]
    environment = {**os.environ, "MYPYPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    found = re.findall(r"^calls\.py:(\d+): error: (.*)$", done.stdout, re.MULTILINE)
    first = setup.count("\n") + 2
    assert {int(line) for line, _ in found} == {*range(first, first + len(MISTAKES))}, done.stdout
    for line, (_, _, reported) in enumerate(MISTAKES, first):
        assert any(reported in text for number, text in found if int(number) == line), done.stdout
