"""Files that the viewer hands out: their names are its own, their content is made in a folder that goes again."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vrte.app.form.content import Content, list_page_wavelengths
from vrte.app.form.files import write_content
from vrte.app.solving.messages import Outcome
from vrte.basics.errors import SceneError
from vrte.formats import save
from vrte.formats.measured_polarized import check_wavelengths


def collect_bytes(name: str, write: Callable[[Path], Any]) -> bytes:
    """What a call writes to a file of that name."""
    with tempfile.TemporaryDirectory(prefix="vrte-view-") as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def make_brdf_download(outcome: Outcome | None, suffix: str) -> tuple[str, bytes]:
    """Name and bytes of the BRDF at all wavelengths, ``suffix`` ".nc" or ".csv". Raises SceneError without one."""
    found = outcome.brdf_to_save() if outcome else None
    if found is None:
        raise SceneError("there is no BRDF to download: solve a scene, or open a file that holds one")
    return f"brdf{suffix}", collect_bytes(f"brdf{suffix}", lambda path: save(found, path))


def make_field_download(outcome: Outcome | None, which: int, suffix: str) -> tuple[str, bytes]:
    """Name and bytes of the field at one of the wavelengths. Raises SceneError without one."""
    if outcome is None or not outcome.fields:
        raise SceneError('there is no field to download: turn on "Inside the layers" and solve')
    field = outcome.fields[which]
    return f"field{suffix}", collect_bytes(f"field{suffix}", lambda path: save(field, path))


def make_scene_download(content: Content) -> tuple[str, bytes]:
    """Name and bytes of the scene. Raises SceneError where the wavelengths are none."""
    return "scene.toml", write_content(content).encode()


def check_tensor(content: Content) -> None:
    """Raises SceneError unless Mitsuba's tensor can be made of a scene."""
    try:
        check_wavelengths(list_page_wavelengths(content))
    except SceneError as error:
        raise SceneError(f"wavelength_um: {error}; for visible light take 0.45, 0.5, 0.55, 0.6, 0.65") from error
