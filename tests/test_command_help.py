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
from vrte import cli
from vrte.basics.errors import SceneError
from vrte.calls import versions
from vrte.cl import device
from vrte.commands import pages
from vrte.commands.common import Parser
from vrte.commands.init import FOLDER, tell_next
from vrte.commands.pages import STARTERS as KINDS
from vrte.commands.parser import make_parser
from vrte.formats.scene_file import FILE_KEYS, read_scene

ROOT = Path(__file__).parents[1]
COMMANDS: dict[str, Parser] = next(
    action.choices for action in make_parser()._actions if isinstance(action.choices, dict)
)
SLOW = (
    "fit",
    "sweep",
    "view",
    "render",
    "materials",
    "paint",
    "brdf",
    "field",
    "devices",
)
INPUT = re.compile(r"[\w./-]+\.(toml|csv)$")


def run(*arguments: str | Path) -> int:
    """The exit code of `vrte` with these arguments."""
    try:
        return cli.main([str(argument) for argument in arguments])
    except SystemExit as leaving:
        return leaving.code  # type: ignore[return-value]


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
        assert [line.split()[0] for line in lines] == list(KINDS) == ["powder", "paint", "cloud", "snow", "sea"]
        assert last == "next: vrte init powder"
        assert {path.stem for path in FOLDER.iterdir()} == set(KINDS)

    @pytest.mark.parametrize("kind", KINDS)
    def test_every_key_of_a_starter_has_its_comment(self, kind: str) -> None:
        """And what the scene is of stands above all keys."""
        first, *lines = (FOLDER / f"{kind}.toml").read_text().splitlines()
        assert first.startswith("# ")
        keys = [line for line in lines if line and not line.lstrip().startswith("#")]
        assert len(keys) >= 10
        for line in keys:
            _, sign, comment = line.partition("  #")
            assert sign, line
            assert len(comment.split()) >= 2, line
        assert not [line for line in lines if len(line) > 125]

    @pytest.mark.parametrize("kind", KINDS)
    def test_pages_that_a_starter_names_are_there(self, kind: str) -> None:
        named = re.findall(r"docs/[\w/]+\.md", (FOLDER / f"{kind}.toml").read_text())
        assert named
        for page in named:
            assert (ROOT / page).is_file(), page

    @pytest.mark.parametrize(
        "kind", [pytest.param(kind, marks=pytest.mark.slow) if kind != "sea" else kind for kind in KINDS]
    )
    def test_what_init_writes_is_solved_by_the_command_that_it_tells(
        self, kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        assert run("init", kind) == 0
        *_, solve, view = capsys.readouterr().out.splitlines()
        assert view == f"in a browser: vrte view {kind}.toml"
        assert Path(f"{kind}.toml").read_text() == (FOLDER / f"{kind}.toml").read_text()
        assert run(*words_of(solve.removeprefix("next: "))) == 0
        assert capsys.readouterr().err == ""
        if kind == "paint":
            assert Path("paint.html").read_bytes().startswith(b"<!doctype html>")
        else:
            assert Path(f"{kind}.png").read_bytes().startswith(b"\x89PNG")

    def test_nothing_is_written_over_without_force(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        path = tmp_path / "mine scene.toml"
        path.write_text("mine")
        assert run("init", "sea", "-o", path) == 2
        assert capsys.readouterr().err == (
            f"vrte: error: {path} is there already: -o names another file, --force writes over it\n"
        )
        assert path.read_text() == "mine"
        assert run("init", "sea", "-o", path, "--force") == 0
        told = capsys.readouterr().out.splitlines()[-2]
        assert words_of(told.removeprefix("next: "))[1] == str(path)
        assert read_scene(path).kind == "brdf"

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            ("init lava", "invalid choice: 'lava'"),
            ("init --force", "--force needs a kind before it: powder, paint, cloud, snow, sea"),
            ("init -o a.toml", "-o needs a kind"),
            ("init sea -o a.txt", "must end in .toml"),
            ("init sea -o absent/a.toml", "a folder that does not exist"),
        ],
    )
    def test_refused_in_one_line(
        self,
        arguments: str,
        words: str,
        tmp_path: Path,
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.chdir(tmp_path)
        assert run(*arguments.split()) == 2
        assert re.fullmatch(r"vrte: error: [^\n]+\n", said := capsys.readouterr().err)
        assert words in said
        assert not list(tmp_path.iterdir())

    def test_without_matplotlib_a_table_is_told(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("vrte.commands.init.importlib.util.find_spec", lambda name: None)
        assert tell_next("cloud", Path("my cloud.toml")) == "vrte field 'my cloud.toml' -o 'my cloud.csv'"


class TestExamples:
    @pytest.mark.parametrize("name", COMMANDS)
    def test_every_command_has_two_whose_options_and_files_exist(self, name: str) -> None:
        """A file is a starter's, one of examples/, or one that an example before has written."""
        examples = COMMANDS[name].examples
        assert len(examples) >= 2
        made = {f"{kind}.toml" for kind in KINDS}
        for line, told in examples:
            words = words_of(line)
            assert words[0] == name
            options = make_parser().parse_args(words)
            for file in inputs(options):
                assert file in made or (file.startswith("examples/") and (ROOT / file).is_file()), line
            made |= {word for word in words if INPUT.match(word)}
            assert len(told.split()) >= 3

    def test_the_tour_is_of_three_commands_that_follow_from_each_other(self) -> None:
        parser = make_parser()
        assert [line.split()[1] for line, _ in parser.examples] == ["init", "brdf", "view"]
        assert [inputs(parser.parse_args(words_of(line))) for line, _ in parser.examples] == [
            [],
            ["powder.toml"],
            ["powder.toml"],
        ]

    @pytest.mark.parametrize("name", COMMANDS)
    def test_help_shows_them_and_names_a_page(self, name: str, capsys: pytest.CaptureFixture[str]) -> None:
        assert run(name, "--help") == 0
        told = capsys.readouterr().out
        for line, words in COMMANDS[name].examples:
            assert f"\n  {line}\n      {words}\n" in told
        page = re.search(r"\nmore: (\S+)\n$", told)
        assert page
        assert (ROOT / page[1]).is_file()
        for kind in KINDS:
            assert (f"`vrte init {kind}` writes {kind}.toml" in told) == (f"{kind}.toml" in told)

    @pytest.mark.parametrize(
        ("name", "line"),
        [
            pytest.param(name, line, marks=pytest.mark.slow if name in SLOW else (), id=line.removeprefix("vrte "))
            for name, parser in COMMANDS.items()
            for line, _ in parser.examples
            if name not in ("view", "completion") and "cards.png" not in line and "--quick" not in line
            if line != "vrte devices --measure"
        ],
    )
    def test_they_run(self, name: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """But for those that take a minute and more, and those that wait for a browser."""
        monkeypatch.chdir(tmp_path)
        shutil.copytree(ROOT / "examples", "examples")
        if name == "sweep":
            table = Path("examples/gold_table.toml")
            table.write_text(re.sub(r"count = 2[18]", "count = 2", table.read_text()))
        for kind in KINDS:
            if f"{kind}.toml" in line:
                assert run("init", kind) == 0
        assert run(*words_of(line)) == 0


class TestPages:
    def test_every_page_is_there(self) -> None:
        named = {*(row["page"] for row in pages.COMMANDS.values()), *pages.OF_KEYS.values(), *pages.OF_ERRORS.values()}
        assert len(named) >= 12
        for page in named:
            assert (ROOT / "docs" / page).is_file(), page
        assert set(pages.COMMANDS) == set(COMMANDS)

    def test_the_tables_of_a_scene_file_have_pages(self) -> None:
        tables = {"particles", "layer", "base", "paint", "render", "brdf", "field"}
        assert tables <= set(FILE_KEYS) & set(pages.OF_KEYS)

    @pytest.mark.parametrize(
        ("place", "page"),
        [
            (("layer", 0, "thicknes"), "docs/reference/scene_files.md"),
            (("particles", "index", "size", "lognormal"), "docs/how_to/particles.md"),
            (("particles", "gold", "index"), "docs/how_to/materials.md"),
            (("paint", "surface", "roughness"), "docs/how_to/rough_surfaces.md"),
            (("base", "albedo"), "docs/how_to/bases.md"),
            (("brdf", "mu_i"), "docs/reference/scene_files.md"),
            ((), None),
        ],
    )
    def test_the_last_step_that_has_a_page_counts(self, place: tuple[str | int, ...], page: str | None) -> None:
        assert pages.find_page(SceneError("wrong", *place)) == page

    @pytest.mark.parametrize(
        ("error", "page"),
        [
            (vrte.AccuracyError("x"), "docs/reference/stability.md"),
            (vrte.DeviceError("x"), "docs/how_to/opencl.md"),
            (vrte.MissingExtraError("x", "files"), "docs/how_to/install.md"),
            (OSError(28, "No space left on device"), None),
        ],
    )
    def test_pages_of_other_errors(self, error: BaseException, page: str | None) -> None:
        assert pages.find_page(error) == page

    @pytest.mark.parametrize(
        ("scene", "last"),
        [
            ('[[layer]]\nalbedo = 1\nthickness = 1\nphase = "raleigh"\n', "(docs/how_to/importing.md)"),
            ("nodes = 0\n", "(docs/reference/scene_files.md)"),
            ("nodes = \n", "(at line 1, column 9)"),
            (None, "No such file or directory"),
        ],
    )
    def test_a_refused_key_ends_with_its_page_and_a_file_that_is_not_there_with_none(
        self, scene: str | None, last: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        path = tmp_path / "scene.toml"
        if scene:
            layer = "" if "layer" in scene else '[[layer]]\nphase = "rayleigh"\nalbedo = 1\nthickness = 1\n'
            path.write_text(f"{scene}{layer}[brdf]\nmu_i = 1\nmu_o = 1\n")
        assert run("brdf", path, "-o", tmp_path / "out.csv") == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1
        assert told.endswith(f" {last}\n")
        assert told.count("docs/") == last.count("docs/")

    @pytest.mark.parametrize(
        ("arguments", "page"),
        [
            ("material --range-um 0.5:0.7:3", "docs/how_to/materials.md"),
            ("material glod --wavelength-um 0.6", "docs/how_to/materials.md"),
            ("phase --normalise", "docs/how_to/importing.md"),
            ("brdf absent.toml --mitsuba-nested --wavelengths-um 0.5 -o a.csv", "docs/how_to/exports.md"),
        ],
    )
    def test_options_that_do_not_go_together(
        self, arguments: str, page: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert run(*arguments.split()) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1
        assert told.endswith(f" ({page})\n")

    def test_on_the_web_where_the_package_says_where(self, monkeypatch: pytest.MonkeyPatch) -> None:
        class Told:
            def get_all(self, name: str) -> list[str]:
                return ["Source, https://example.org/code", "Documentation, https://example.org/docs/"]

        monkeypatch.setattr(metadata, "metadata", lambda name: Told())
        pages.find_site.cache_clear()
        try:
            assert pages.locate_page("how_to/bases.md") == "https://example.org/docs/how_to/bases.html"
            assert pages.locate_page("reference/benchmarks/README.md").endswith("/reference/benchmarks/index.html")
        finally:
            pages.find_site.cache_clear()


def test_the_page_of_commands_has_every_option_and_example() -> None:
    page = write_page()
    for name, command in COMMANDS.items():
        section = page.split(f"\n## vrte {name}\n")[1].split("\n## ")[0]
        for action in command._actions:
            assert action.dest == "help" or all(f"`{one}`" in section for one in action.option_strings)
            assert action.help, f"vrte {name}: {action.dest} is not explained"
        assert all(f"# {told}\n{line}\n" in section for line, told in command.examples)


class TestVersions:
    def test_one_line_without_verbose_and_a_report_with_it(self, capsys: pytest.CaptureFixture[str]) -> None:
        for arguments in (("--version", "--verbose"), ("--verbose", "--version")):
            assert run(*arguments) == 0
            told = capsys.readouterr().out
        first, *lines = told.splitlines()
        assert first == f"vrte {vrte.__version__}"
        facts = dict(line.split(": ", 1) for line in lines)
        assert set(facts) >= {"Python", "processor", "compiled core", "BLAS 1", "refractive indices", "OpenCL"}
        assert "OpenMP" in facts["compiled core"]
        assert facts["refractive indices"].startswith("refractiveindex.info v")
        numpy = f"numpy {metadata.version('numpy')}"
        assert numpy in facts["installed"].split(", ")
        vrte.show_versions()
        assert capsys.readouterr().out.splitlines()[0] == first

    def test_no_home_and_what_the_environment_sets(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("HOME", "/home/somebody")
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
        monkeypatch.setenv("VRTE_OPENCL_DEVICE", "/home/somebody/card")
        monkeypatch.setenv("SECRET_TOKEN", "abc")
        told = versions.describe_versions()
        assert {"OPENBLAS_NUM_THREADS=3", "VRTE_OPENCL_DEVICE=~/card"} <= set(
            told.splitlines()[-1].removeprefix("environment: ").split(", ")
        )
        assert "somebody" not in told
        assert "abc" not in told
        assert versions.hide_home("/home/somebody-else /home/somebody/a") == "/home/somebody-else ~/a"

    def test_what_is_missing_is_named_and_no_failure(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def devices() -> None:
            raise vrte.DeviceError("there is no OpenCL platform")

        def version(name: str) -> str:
            if name in ("zarr", "xarray"):
                raise metadata.PackageNotFoundError(name)
            return "1.0"

        monkeypatch.setattr(device, "devices", devices)
        monkeypatch.setattr(metadata, "version", version)
        monkeypatch.setattr(
            metadata,
            "requires",
            lambda name: [
                "numpy>=2.0",
                'zarr>=3; extra == "files"',
                'xarray; extra == "files"',
                'vrte[files]; extra == "dask"',
                'ruff>=0.9; extra == "test"',
            ],
        )
        lines = versions.describe_versions().splitlines()
        assert {"OpenCL: there is no OpenCL platform", "installed: numpy 1.0", "not installed: xarray, zarr"} <= set(
            lines
        )
        monkeypatch.setattr(versions, "find_versions", dict)
        assert "installed: none" in versions.describe_versions()

    def test_extras_that_are_not_for_users_are_there(self) -> None:
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        assert set(extras) >= versions.DEVELOPMENT
