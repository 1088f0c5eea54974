"""Files that the viewer hands out: their names are its own, their content is made in a folder that goes again."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from vrte.app.form import scene_text, wavelengths_of
from vrte.app.messages import Outcome
from vrte.basics.errors import SceneError
from vrte.formats import save
from vrte.formats.contents import Result
from vrte.formats.measured_polarized import check_wavelengths


def brdf_file(outcome: Outcome | None, suffix: str) -> tuple[str, bytes]:
    """Name and bytes of the BRDF at all wavelengths, ``suffix`` ".nc" or ".csv". Raises SceneError without one."""
    found = outcome.brdf_to_save() if outcome else None
    if found is None:
        raise SceneError("there is no BRDF to download: solve a scene, or open a file that holds one")
    return f"brdf{suffix}", bytes_of(found, suffix)


def field_file(outcome: Outcome | None, which: int, suffix: str) -> tuple[str, bytes]:
    """Name and bytes of the field at one of the wavelengths. Raises SceneError without one."""
    if outcome is None or not outcome.fields:
        raise SceneError('there is no field to download: turn on "Inside the layers" and solve')
    return f"field{suffix}", bytes_of(outcome.fields[which], suffix)


def bytes_of(result: Result, suffix: str) -> bytes:
    """What `save` writes."""
    return written(f"result{suffix}", lambda path: save(result, path))


def written(name: str, write: Callable[[Path], None]) -> bytes:
    """What a call writes to a file."""
    with tempfile.TemporaryDirectory(prefix="vrte-view-") as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def scene_file(content: dict[str, object]) -> tuple[str, bytes]:
    """Name and bytes of the scene. Raises SceneError where the wavelengths are none."""
    return "scene.toml", scene_text(content).encode()


def check_tensor(content: dict[str, object]) -> None:
    """Raises SceneError unless Mitsuba's tensor can be made of a scene."""
    try:
        check_wavelengths(wavelengths_of(content))
    except SceneError as error:
        raise SceneError(f"wavelength_um: {error}; for visible light take 0.45, 0.5, 0.55, 0.6, 0.65") from error
