"""The viewer's server: what it answers, and how it begins and ends."""

import socket
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from tests.viewer_server import viewer
from vrte import cli
from vrte.app.server import free_port


def test_only_its_own_names_are_answered() -> None:
    with viewer() as (url, _):
        with urllib.request.urlopen(url) as answer:
            assert "default-src 'self'" in answer.headers["content-security-policy"]
            assert "://" not in answer.read().decode().replace("http://www.w3.org/2000/svg", "").replace(url, "")
        elsewhere = urllib.request.Request(url, headers={"Host": "elsewhere.example"})  # a name that leads here
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(elsewhere)
        refused.value.close()
        assert refused.value.code == 400


def test_a_taken_port_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert cli.main(["view", "--no-browser", "--port", str(port)]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"vrte: error: the viewer cannot listen on port {port} of 127.0.0.1 (")
        assert said.count("\n") == 1
        assert free_port("127.0.0.1", 0) != port


def test_a_host_that_is_none_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["view", "--no-browser", "--host", "192.0.2.1"]) == 2
    assert "cannot listen on port 8765 of 192.0.2.1" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("gone.toml", None, "No such file"),
        ("bad.toml", "layer = 3\n[brdf]\nmu_i = 1\nmu_o = 1", "layer = 3: must be tables"),
        ("bad.nc", "text", "is not a NetCDF file"),
        ("bad.csv", "text", "bad.csv"),
    ],
)
def test_a_file_that_is_none_is_told_before_a_page_opens(
    name: str, text: str | None, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    assert cli.main(["view", "--no-browser", str(tmp_path / name)]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
