"""`vrte completion`: scripts as shells take them, and what a real bash completes with one."""

import contextlib
import io
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from vrte.commands.completion import SHELLS

from .helpers import run

pytest.importorskip("shtab")
BASH = shutil.which("bash")
ASK = """
source vrte.bash
COMP_WORDS=({words}) COMP_CWORD={last}
$(complete -p vrte | sed 's/.*-F \\([^ ]*\\).*/\\1/')
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the script for each shell, some files, and a folder."""
    found = tmp_path_factory.mktemp("completion")
    for name in ("gold.toml", "snow.toml", "gold.png", "notes.txt"):
        (found / name).touch()
    (found / "scenes").mkdir()
    for shell in SHELLS:
        with contextlib.redirect_stdout(io.StringIO()) as reported:
            assert run("completion", shell) == 0
        (found / f"vrte.{shell}").write_text(reported.getvalue())
    return found


@pytest.mark.skipif(BASH is None, reason="there is no bash")
@pytest.mark.parametrize(
    ("line", "wanted", "unwanted"),
    [
        ("vrte b", {"brdf"}, {"paint"}),
        ("vrte brdf ''", {"gold.toml", "snow.toml", "scenes"}, {"gold.png", "notes.txt"}),
        ("vrte brdf g", {"gold.toml"}, {"snow.toml", "gold.png"}),
        ("vrte brdf gold.toml --plot ''", {"gold.png", "scenes"}, {"gold.toml", "notes.txt"}),
        ("vrte brdf gold.toml --alg", {"--algorithm"}, {"--accuracy"}),
        ("vrte brdf gold.toml --algorithm ''", {"modes", "doubling", "auto"}, {"gold.toml"}),
        ("vrte render gold.toml s", {"snow.toml", "scenes"}, {"gold.toml"}),
        ("vrte init ''", {"powder", "paint", "cloud", "snow", "sea"}, {"gold.toml"}),
        ("vrte material rut", {"rutile", "rutile_in_alkyd"}, {"gold"}),
        ("vrte completion ''", set(SHELLS), set()),
    ],
)
def test_a_real_bash_completes(line: str, wanted: set[str], unwanted: set[str], folder: Path) -> None:
    assert BASH
    script = ASK.format(words=line, last=len(shlex.split(line)) - 1)
    reported = subprocess.run([BASH, "--norc", "-c", script], cwd=folder, capture_output=True, text=True, check=True)
    assert reported.stderr == ""
    assert wanted <= {*reported.stdout.split()}
    assert not unwanted & {*reported.stdout.split()}


@pytest.mark.parametrize("shell", SHELLS)
def test_shells_read_their_scripts(shell: str, folder: Path) -> None:
    """As far as they are here."""
    path = folder / f"vrte.{shell}"
    assert "brdf" in path.read_text()
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"there is no {shell}")
    command = [program, "-f", "-c", f"source {path}"] if shell == "tcsh" else [program, "-n", str(path)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stderr == ""


def test_every_material_that_is_completed_is_known(folder: Path) -> None:
    for name in ("zinc_oxide", "rutile_in_alkyd", "soda-lime_glass"):
        assert name in (folder / "vrte.bash").read_text()
        assert run("material", name, "--wavelength-um", "0.55") == 0


def test_without_the_extra_it_is_named(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert run("completion", "bash") == 1
    words = "vrte completion needs the extra 'completion': pip install 'vrte[completion]' (docs/how_to/install.md)"
    assert capsys.readouterr().err == f"vrte: error: {words}\n"
