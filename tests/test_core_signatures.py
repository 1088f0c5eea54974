"""The compiled core's signatures: what _core.pyi says is what is compiled, and mypy finds a swapped argument."""

import ast
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from vrte import _core

ROOT = Path(__file__).parents[1]
STUB = ast.parse((ROOT / "vrte" / "_core.pyi").read_text())
DECLARED = {node.name: node.args for node in ast.walk(STUB) if isinstance(node, ast.FunctionDef)}
CALL = (
    "_core.order_bounds(crew, coefficients=a, terms=i, albedo=a, directions=a, weights=a, n_out=1, strength=a, "
    "bounds=a, effect=a)"
)
MISTAKES = [  # what is written instead of what, and what mypy says of it
    ("terms=i, albedo=a", "terms=a, albedo=i", 'Argument "terms" has incompatible type'),
    ("n_out=1, strength=a", "n_out=a, strength=1", 'Argument "n_out" has incompatible type'),
    ("coefficients=a, terms=i", "a, i", "Too many positional arguments"),
    ("bounds=a, ", "", 'Missing named argument "bounds"'),
    ("effect=a", "effects=a", 'Unexpected keyword argument "effects"'),
]


@pytest.mark.parametrize("name", sorted(DECLARED))
def test_what_is_declared_is_what_is_compiled(name: str) -> None:
    args = DECLARED[name]
    declared = [[arg.arg for arg in group if arg.arg != "self"] for group in (args.args, args.kwonlyargs)]
    compiled = inspect.signature(getattr(_core, name)).parameters.values()
    kinds = inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY
    assert declared == [[each.name for each in compiled if each.kind is kind] for kind in kinds]


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
    assert sorted({int(line) for line, _ in found}) == list(range(first, first + len(MISTAKES))), done.stdout
    for line, (_, _, said) in enumerate(MISTAKES, first):
        assert any(said in text for number, text in found if int(number) == line), done.stdout
