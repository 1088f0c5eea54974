"""What is written as TOML reads back as it was."""

import json
import math
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vrte
from vrte.formats.scene_file import make_scene_file, read_content
from vrte.formats.toml_table import write_toml

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
VALUE = st.recursive(
    st.one_of(st.booleans(), st.integers(), st.floats(allow_nan=False), TEXT),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(TEXT, inner, max_size=3)),
    max_leaves=8,
)


@settings(max_examples=60)
@given(st.dictionaries(st.one_of(TEXT, st.sampled_from(["particles", "layer", "brdf"])), VALUE, max_size=6))
def test_any_content_reads_back(content: dict[str, object]) -> None:
    found = tomllib.loads(write_toml(content))
    assert found == content
    assert json.dumps(found, sort_keys=True) == json.dumps(content, sort_keys=True)  # 1, 1.0 and true are not the same


def test_every_example_reads_back(tmp_path: Path) -> None:
    for path in (Path(__file__).parents[1] / "examples").glob("*.toml"):
        content = read_content(path)
        (tmp_path / path.name).write_text(write_toml(content), encoding="utf-8")
        assert read_content(tmp_path / path.name) == content


def test_the_numbers_that_need_care() -> None:
    content = {"a": [math.inf, -math.inf, 1e16, 1e-7, -0.0, 10**300], "b": 'q"\\\n\t\x00\x7f\x9f\u2028'}
    assert tomllib.loads(write_toml(content)) == content
    assert math.isnan(tomllib.loads(write_toml({"a": math.nan}))["a"])


def test_particles_have_headings_of_their_own() -> None:
    content = {
        "particles": {"fool's gold": {"index": [1.5, 0.0], "radius_um": 0.1}},
        "wavelength_um": 0.5,
        "layer": [{"particles": "fool's gold", "thickness": 1.0}],
        "brdf": {"mu_i": {"start": 0.5, "stop": 1.0, "count": 2}, "mu_o": 0.5},
    }
    text = write_toml(content)
    assert '[particles."fool\'s gold"]' in text
    assert "[[layer]]" in text
    assert "mu_i = { start = 0.5, stop = 1.0, count = 2 }" in text
    assert make_scene_file(tomllib.loads(text)).scene.thickness == 1.0


@pytest.mark.parametrize("value", ["\ud800", None, b"x", 10**4000])
def test_what_no_scene_holds_is_refused(value: object) -> None:
    with pytest.raises(vrte.SceneError, match="cannot be written"):
        write_toml({"a": value})


def test_too_deep_is_refused() -> None:
    value: object = 1
    for _ in range(100):
        value = [value]
    with pytest.raises(vrte.SceneError, match="too deeply"):
        write_toml({"a": value})
