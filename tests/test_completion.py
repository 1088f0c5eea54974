"""`vrte completion`: scripts as shells take them, and what a real bash completes with one."""

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from vrte import cli
from vrte.commands.completion import SHELLS

pytest.importorskip("shtab")
BASH = shutil.which("bash")
ASK = """
source vrte.bash
COMP_WORDS=({words}) COMP_CWORD={last}
{function}
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the script for bash, some files, and a folder."""
    found = tmp_path_factory.mktemp("completion")
    for name in ("gold.toml", "snow.toml", "gold.png", "notes.txt"):
        (found / name).touch()
    (found / "scenes").mkdir()
    return found


@pytest.fixture(scope="module")
def scripts() -> dict[str, str]:
    """What is printed for each shell."""
    import contextlib
    import io

    found = {}
    for shell in SHELLS:
        with contextlib.redirect_stdout(io.StringIO()) as told:
            assert cli.main(["completion", shell]) == 0
        found[shell] = told.getvalue()
    return found


@pytest.mark.skipif(BASH is None, reason="there is no bash")
@pytest.mark.parametrize(
    ("words", "wanted", "unwanted"),
    [
        (["vrte", "b"], {"brdf"}, {"paint"}),
        (["vrte", "brdf", ""], {"gold.toml", "snow.toml", "scenes"}, {"gold.png", "notes.txt"}),
        (["vrte", "brdf", "g"], {"gold.toml"}, {"snow.toml", "gold.png"}),
        (["vrte", "brdf", "gold.toml", "--plot", ""], {"gold.png", "scenes"}, {"gold.toml", "notes.txt"}),
        (["vrte", "brdf", "gold.toml", "--alg"], {"--algorithm"}, {"--accuracy"}),
        (["vrte", "brdf", "gold.toml", "--algorithm", ""], {"modes", "doubling", "auto"}, {"gold.toml"}),
        (["vrte", "render", "gold.toml", "s"], {"snow.toml", "scenes"}, {"gold.toml"}),
        (["vrte", "init", ""], {"powder", "paint", "cloud", "snow", "sea"}, {"gold.toml"}),
        (["vrte", "material", "rut"], {"rutile", "rutile_in_alkyd"}, {"gold"}),
        (["vrte", "completion", ""], set(SHELLS), set()),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_real_bash_completes(
    words: list[str], wanted: set[str], unwanted: set[str], folder: Path, scripts: dict[str, str]
) -> None:
    (folder / "vrte.bash").write_text(scripts["bash"])
    assert BASH
    named = subprocess.run(
        [BASH, "--norc", "-c", "source vrte.bash; complete -p vrte"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    function = shlex.split(named.stdout)[named.stdout.split().index("-F") + 1]
    script = ASK.format(words=shlex.join(words), last=len(words) - 1, function=function)
    told = subprocess.run([BASH, "--norc", "-c", script], cwd=folder, capture_output=True, text=True, check=True)
    assert told.stderr == ""
    found = set(told.stdout.split())
    assert wanted <= found
    assert not unwanted & found


@pytest.mark.parametrize("shell", SHELLS)
def test_shells_read_their_scripts(shell: str, folder: Path, scripts: dict[str, str]) -> None:
    """As far as they are here."""
    assert "brdf" in scripts[shell]
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"there is no {shell}")
    path = folder / f"script.{shell}"
    path.write_text(scripts[shell])
    command = [program, "-f", "-c", f"source {path}"] if shell == "tcsh" else [program, "-n", str(path)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stderr == ""


def test_every_material_that_is_completed_is_known(scripts: dict[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("zinc_oxide", "rutile_in_alkyd", "soda-lime_glass"):
        assert name in scripts["bash"]
        assert cli.main(["material", name, "--wavelength-um", "0.55"]) == 0


def test_without_the_extra_it_is_told_how_to_get_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert cli.main(["completion", "bash"]) == 1
    assert capsys.readouterr().err == (
        "vrte: error: vrte completion needs the extra 'completion': pip install 'vrte[completion]' "
        "(docs/how_to/install.md)\n"
    )
