"""Help that helps: starter scenes, examples of every command, pages that errors name, and what a bug report needs."""

import re
import shlex
import shutil
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

import vrte
from docs.scripts.commands import write_page
from vrte.basics.errors import SceneError
from vrte.calls import versions
from vrte.cl import device
from vrte.commands import common
from vrte.commands.common import Parser, make_parser
from vrte.commands.init import suggest_next
from vrte.formats.scene_file import FILE_KEYS, read_scene

from .helpers import run

ROOT = Path(__file__).parents[1]
COMMANDS: dict[str, Parser] = next(
    action.choices for action in make_parser()._actions if isinstance(action.choices, dict)
)
KINDS = {kind: common.find_starter(kind).name for kind in common.STARTERS}
SCENES = [kind for kind in KINDS if kind not in ("match", "measurement")]
SLOW = ("export", "fit", "sweep", "view", "render", "materials", "paint", "brdf", "field", "devices")
INPUT = re.compile(r"[\w./-]+\.(toml|csv)$")


def words_of(line: str) -> list[str]:
    """The words of a command line after `vrte`, up to where a shell sends the output."""
    first, *words = shlex.split(line)
    assert first == "vrte"
    return words[: words.index(">")] if ">" in words else words


def inputs(options: Any) -> list[str]:
    """Files that a command reads, as its parser understood them."""
    found = [getattr(options, name, None) for name in ("scene", "file", "name")] + list(getattr(options, "scenes", []))
    return [str(one) for one in found if one is not None and INPUT.match(str(one))]


class TestInit:
    def test_alone_it_lists_the_kinds_and_how_to_go_on(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("init") == 0
        *lines, last = capsys.readouterr().out.splitlines()
        assert (
            [line.split()[0] for line in lines]
            == list(KINDS)
            == ["powder", "paint", "cloud", "snow", "sea", "match", "measurement"]
        )
        assert last == "next: vrte init powder"
        assert {path.stem for path in common.FOLDER.iterdir()} == set(KINDS)

    @pytest.mark.parametrize(
        "kind", [pytest.param(kind, marks=pytest.mark.slow) if kind != "sea" else kind for kind in SCENES]
    )
    def test_what_init_writes_is_solved_by_the_command_that_it_tells(
        self, kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        assert run("init", kind) == 0
        *_, solve, view = capsys.readouterr().out.splitlines()
        assert view == f"in a browser: vrte view {kind}.toml"
        assert Path(f"{kind}.toml").read_text() == common.find_starter(kind).read_text()
        assert run(*words_of(solve.removeprefix("next: "))) == 0
        assert capsys.readouterr().err == ""
        name, start = ("paint.html", b"<!doctype html>") if kind == "paint" else (f"{kind}.png", b"\x89png")
        assert Path(name).read_bytes().lower().startswith(start)

    def test_over_a_file_by_force_and_without_matplotlib_a_table(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = tmp_path / "mine scene.toml"
        path.write_text("mine")
        assert run("init", "sea", "-o", path) == 2
        assert path.read_text() == "mine"
        assert run("init", "sea", "-o", path, "--force") == 0
        reported = capsys.readouterr().out.splitlines()[-2]
        assert words_of(reported.removeprefix("next: "))[1] == str(path)
        assert read_scene(path).kind == "brdf"
        monkeypatch.setattr("vrte.commands.init.importlib.util.find_spec", lambda name: None)
        assert suggest_next("cloud", Path("my cloud.toml")) == "vrte field 'my cloud.toml' -o 'my cloud.csv'"


class TestExamples:
    @pytest.mark.parametrize("name", COMMANDS)
    def test_every_command_has_two_whose_options_and_files_exist(
        self, name: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """A file is a starter's, one of examples/, or one that an example before has written; help shows them and names
        a page, and the page of all commands has every option and example."""
        examples, made = COMMANDS[name].examples, {*KINDS.values()}
        assert len(examples) >= 2
        assert run(name, "--help") == 0
        reported = capsys.readouterr().out
        section = write_page().split(f"\n## vrte {name}\n")[1].split("\n## ")[0]
        for line, words in examples:
            assert words_of(line)[0] == name
            for file in inputs(make_parser().parse_args(words_of(line))):
                assert file in made or (file.startswith("examples/") and (ROOT / file).is_file()), line
            made |= {word for word in words_of(line) if INPUT.match(word)}
            assert len(words.split()) >= 3
            assert f"\n  {line}\n      {words}\n" in reported
            assert f"# {words}\n{line}\n" in section
        page = re.search(r"\nmore: (\S+)\n$", reported)
        assert page
        assert (ROOT / page[1]).is_file()
        for kind, file in KINDS.items():
            assert (f"`vrte init {kind}` writes {file}" in " ".join(reported.split())) == (file in reported)
        for action in COMMANDS[name]._actions:
            assert action.dest == "help" or all(f"`{one}`" in section for one in action.option_strings)
            assert action.help, f"vrte {name}: {action.dest} is not explained"

    @pytest.mark.parametrize(
        ("name", "line"),
        [
            pytest.param(name, line, marks=pytest.mark.slow if name in SLOW else (), id=line.removeprefix("vrte "))
            for name, parser in COMMANDS.items()
            for line, _ in parser.examples
            if name not in ("view", "completion") and "cards.png" not in line and line != "vrte devices --measure"
        ],
    )
    def test_they_run(self, name: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """But for those that take a minute and more, and those that wait for a browser."""
        monkeypatch.chdir(tmp_path)
        shutil.copytree(ROOT / "examples", "examples")
        if name == "sweep":
            table = Path("examples/gold_table.toml")
            table.write_text(re.sub(r"count = 2[18]", "count = 2", table.read_text()))
        for kind, file in KINDS.items():
            if file in line:
                assert run("init", kind) == 0
        assert run(*words_of(line)) == 0


class TestPages:
    def test_every_page_is_there(self) -> None:
        named = {
            *(row["page"] for row in common.COMMANDS.values()),
            *common.OF_KEYS.values(),
            *common.OF_ERRORS.values(),
        }
        assert len(named) >= 12
        assert not [page for page in named if not (ROOT / "docs" / page).is_file()]
        starters = "".join(path.read_text() for path in common.FOLDER.iterdir())
        assert all((ROOT / page).is_file() for page in re.findall(r"docs/[\w/]+\.md", starters))
        assert set(common.COMMANDS) == set(COMMANDS)
        tables = {"particles", "layer", "base", "paint", "render", "brdf", "field"}
        assert tables <= set(FILE_KEYS) & set(common.OF_KEYS)

    @pytest.mark.parametrize(
        ("error", "page"),
        [  # of a place, the last step that has a page counts
            (SceneError("wrong", "layer", 0, "thicknes"), "docs/reference/scene_files.md"),
            (SceneError("wrong", "particles", "index", "size", "lognormal"), "docs/how_to/particles.md"),
            (SceneError("wrong", "particles", "gold", "index"), "docs/how_to/materials.md"),
            (SceneError("wrong", "paint", "surface", "roughness"), "docs/how_to/rough_surfaces.md"),
            (SceneError("wrong", "base", "albedo"), "docs/how_to/bases.md"),
            (SceneError("wrong", "brdf", "mu_i"), "docs/reference/scene_files.md"),
            (SceneError("wrong"), None),
            (vrte.AccuracyError("x"), "docs/reference/stability.md"),
            (vrte.DeviceError("x"), "docs/how_to/opencl.md"),
            (vrte.MissingExtraError("x", "files"), "docs/how_to/install.md"),
            (OSError(28, "No space left on device"), None),
        ],
    )
    def test_pages_of_errors(self, error: BaseException, page: str | None) -> None:
        assert common.find_page(error) == page

    def test_on_the_web_where_the_package_says_where(self, monkeypatch: pytest.MonkeyPatch) -> None:
        class Told:
            def get_all(self, name: str) -> list[str]:
                return ["Source, https://example.org/code", "Documentation, https://example.org/docs/"]

        monkeypatch.setattr(metadata, "metadata", lambda name: Told())
        common.find_site.cache_clear()
        try:
            assert common.locate_page("how_to/bases.md") == "https://example.org/docs/how_to/bases.html"
            assert common.locate_page("reference/benchmarks/README.md").endswith("/reference/benchmarks/index.html")
        finally:
            common.find_site.cache_clear()


class TestVersions:
    def test_a_report_with_verbose(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("--verbose", "--version") == 0
        first, *lines = capsys.readouterr().out.splitlines()
        assert first == f"vrte {vrte.__version__}"
        facts = dict(line.split(": ", 1) for line in lines)
        assert set(facts) >= {"Python", "processor", "compiled core", "BLAS 1", "refractive indices", "OpenCL"}
        assert "OpenMP" in facts["compiled core"]
        assert facts["refractive indices"].startswith("refractiveindex.info v")
        assert f"numpy {metadata.version('numpy')}" in facts["installed"].split(", ")
        vrte.show_versions()
        assert capsys.readouterr().out.splitlines()[0] == first

    def test_no_home_what_the_environment_sets_and_what_is_missing(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def devices() -> None:
            raise vrte.DeviceError("there is no OpenCL platform")

        def version(name: str) -> str:
            if name in ("zarr", "xarray"):
                raise metadata.PackageNotFoundError(name)
            return "1.0"

        for name, value in (
            ("HOME", "/home/somebody"),
            ("OPENBLAS_NUM_THREADS", "3"),
            ("VRTE_OPENCL_DEVICE", "/home/somebody/card of /home/somebody-else"),
            ("SECRET_TOKEN", "abc"),
        ):
            monkeypatch.setenv(name, value)
        required = ["numpy>=2.0", *(f'{name}; extra == "files"' for name in ("zarr>=3", "xarray"))]
        required += ['vrte[files]; extra == "dask"', 'ruff>=0.9; extra == "test"']
        monkeypatch.setattr(device, "devices", devices)
        monkeypatch.setattr(metadata, "version", version)
        monkeypatch.setattr(metadata, "requires", lambda name: required)
        reported = versions.describe_versions()
        *lines, last = reported.splitlines()
        assert {"OpenCL: there is no OpenCL platform", "installed: numpy 1.0", "not installed: xarray, zarr"} <= {
            *lines
        }
        variables = {*last.removeprefix("environment: ").split(", ")}
        assert {"OPENBLAS_NUM_THREADS=3", "VRTE_OPENCL_DEVICE=~/card of /home/somebody-else"} <= variables
        assert "abc" not in reported
        monkeypatch.setattr(versions, "find_versions", dict)
        assert "installed: none" in versions.describe_versions()
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        assert set(extras) >= versions.DEVELOPMENT
