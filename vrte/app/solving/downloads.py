"""Files that the viewer hands out: their names are its own, their content is made in a folder that goes again."""

import io
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.app.form.content import Content, list_page_wavelengths
from vrte.app.form.files import write_content
from vrte.app.solving.messages import Outcome
from vrte.app.solving.uploads import Uploads
from vrte.basics.errors import SceneError
from vrte.formats import save
from vrte.formats.measured_polarized import check_wavelengths
from vrte.formats.named import find_named_tables
from vrte.results.spectrum import Spectrum

if TYPE_CHECKING:
    from vrte.app.solving.worker_process import LiveQuery

TENSOR_UM = 0.45, 0.5, 0.55, 0.6, 0.65


def collect_bytes(name: str, write: Callable[[Path], Any]) -> bytes:
    """What a call writes to a file of that name."""
    with tempfile.TemporaryDirectory(prefix="vrte-view-") as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def make_result_download(kind: str, outcome: Outcome | None, suffix: str, which: int = 0) -> tuple[str, bytes]:
    """Name and bytes of the "brdf" at all wavelengths or the "field" at one, ``suffix`` ".nc" or ".csv". Raises
    SceneError without one."""
    brdfs, fields = (outcome.brdfs, outcome.fields) if outcome else ((), ())
    if kind == "brdf" and not brdfs:
        raise SceneError("there is no BRDF to download: solve a scene, or open a file that holds one")
    if kind == "field" and not fields:
        raise SceneError('there is no field to download: turn on "Inside the layers" and solve')
    found: Any = fields[which] if kind == "field" else brdfs[0]
    if kind == "brdf" and outcome and len(brdfs) > 1:
        found = Spectrum(np.array(outcome.wavelength_um), brdfs)
    return f"{kind}{suffix}", collect_bytes(f"{kind}{suffix}", lambda path: save(found, path))


def make_scene_download(content: Content, uploads: Uploads) -> tuple[str, bytes]:
    """Name and bytes of the scene, in an archive with the files that it names. Raises SceneError where the wavelengths
    are none, OSError where a file has gone."""
    scene = write_content(content)
    names = sorted(set(list_beside(content)) & uploads.names)
    if not names:
        return "scene.toml", scene.encode()
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("scene.toml", scene)
        for name in names:
            archive.writestr(name, (uploads.folder / name).read_bytes())
    return "scene.zip", packed.getvalue()


def list_beside(content: Content) -> list[str]:
    """The files that a scene names beside it, but not those elsewhere.

    >>> list_beside({"layer": [{"phase": "../fog.csv"}, {"phase": "data/haze.csv"}]})
    ['data/haze.csv']
    """
    named = dict.fromkeys(find_named_tables(content).values())
    return [name for name in named if ".." not in Path(name).parts and not Path(name).is_absolute()]


def choose_tensor_wavelengths(content: Content) -> tuple[float, ...]:
    """The five wavelengths [um] of Mitsuba's tensor: the form's where these are five, else five from its first to its
    last, or those of the visible where it has one. Raises SceneError where they are none."""
    given = list_page_wavelengths(content)
    if len(given) < 2:
        return TENSOR_UM
    found = given if len(given) == len(TENSOR_UM) else np.linspace(given[0], given[-1], 5).round(3).tolist()
    try:
        check_wavelengths(found)
    except SceneError as error:
        raise SceneError(f"wavelength_um: {error}") from error
    return tuple(found)


def make_colours_download(live: "LiveQuery", content: Content) -> tuple[str, bytes]:
    """Name and bytes of what the tab Appearance shows of the form's scene. Raises SceneError where it shows nothing, or
    not yet all."""
    from vrte.app.solving.appearance import Appeared, list_readings
    from vrte.pictures.paint import write_table

    answer, asked = live.answer, live.answered
    if not isinstance(answer, Appeared) or answer.follows or asked is None or asked.content != content:
        raise SceneError("there are no colours of this scene yet: open the tab Appearance, and wait for its answer")
    return "colours.csv", write_table(list_readings(answer)).encode()
