"""What the README shows works as it stands."""

import re
from pathlib import Path

import pytest

from vrte.formats.scene_file import read_scene

README = Path(__file__).parents[1] / "README.md"


def blocks(language: str) -> list[str]:
    """The code blocks of one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", README.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def test_the_python_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), names)
    assert (tmp_path / "gold.nc").is_file()


@pytest.mark.parametrize("kind", ["brdf", "field"])
def test_the_scene_file_is_read(kind: str, tmp_path: Path) -> None:
    (scene,) = blocks("toml")
    (tmp_path / "scene.toml").write_text(scene)
    file = read_scene(tmp_path / "scene.toml", kind)
    assert len(file.scene.layers) == 2
    assert file.scene.base is not None
