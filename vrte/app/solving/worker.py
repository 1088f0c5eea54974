"""The process that solves for the viewer: one task in, its progress and its outcome out, then it ends.

Also in the middle of a solve it ends when its input does, so that none is left when the viewer is gone.
"""

import os
import pickle
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from vrte.app.form.content import Content, at, keywords_of, wavelengths_of
from vrte.app.form.files import adopted
from vrte.app.solving.downloads import bytes_written
from vrte.app.solving.messages import Answer, Inside, Outcome, Planned, Progress, Read, Solve, Task, Tensor, Written
from vrte.app.solving.reflectance import other_base, reflectances
from vrte.basics.arrays import in_one_line
from vrte.basics.errors import AccuracyError, DeviceError, MissingExtraError, SceneError
from vrte.basics.limits import limit_memory
from vrte.calls.brdf import brdf
from vrte.calls.plan import plan
from vrte.calls.radiance import radiance
from vrte.calls.spectrum import spectrum
from vrte.formats import load
from vrte.formats.scene_file import FILLINGS, SceneFile, scene_of, toml_content
from vrte.formats.scene_writer import toml_text
from vrte.formats.toml_table import shown_key
from vrte.request.how import AUTO, EXACT
from vrte.results.brdf import Brdf
from vrte.results.field import Field, one_beam
from vrte.results.spectrum import SCENE, Spectrum, with_scene

Tell = Callable[[Progress], None]
MOST_NAMED = 30  # warnings


def main() -> None:
    """Reads a task, answers, ends."""
    output = os.fdopen(os.dup(1), "wb")  # for messages alone:
    os.dup2(2, 1)  # what anything prints goes to standard error
    task: Task = pickle.load(sys.stdin.buffer)
    threading.Thread(target=end_with_input, daemon=True).start()
    limit_memory(task.memory_bytes)
    lock = threading.Lock()

    def tell(message: Progress | Answer) -> None:
        with lock:
            pickle.dump(message, output, protocol=pickle.HIGHEST_PROTOCOL)
            output.flush()

    tell(answer(task, tell))
    os._exit(0)  # at once: nothing is left to do, and threads of the linear algebra may be waiting


def end_with_input() -> None:
    """Ends the process when nobody waits for it any more."""
    sys.stdin.buffer.read()
    os._exit(1)


def answer(task: Task, tell: Tell) -> Answer:
    """What comes of a task; any error is a sentence."""
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UserWarning)
            if isinstance(task, Tensor):
                return write_tensor(task, tell)
            found = solve(task, tell) if isinstance(task, Solve) else read(task)
    except (SceneError, AccuracyError, DeviceError, MissingExtraError, OSError) as error:
        return in_one_line(str(error), 1000)
    except MemoryError:
        return "not enough memory for this scene: fewer directions, nodes or wavelengths need less"
    except Exception as error:  # never seen; a page must not wait for ever
        return in_one_line(f"{type(error).__name__}: {error}", 1000)
    notes = dict.fromkeys(str(one.message) for one in caught if issubclass(one.category, UserWarning))
    return replace(found, notes=tuple(notes)[:MOST_NAMED])


def solve(task: Solve, tell: Tell) -> Outcome:
    """The BRDF at every wavelength, and the field where it is asked for."""
    content = task.content
    wavelengths, text = wavelengths_of(content), toml_text(content)
    with_field = "field" in content
    count = len(wavelengths) * (3 if with_field else 2)
    steps = iter(range(count))

    def begin(stage: str, which: int) -> Callable[[int, int], None]:
        """Progress within one step of one wavelength."""
        step, where = next(steps), f" at {wavelengths[which]:g} um" if len(wavelengths) > 1 else ""
        tell(Progress(step / count, f"{stage}{where}"))
        return lambda done, total: tell(
            Progress((step + done / max(total, 1)) / count, f"{stage}{where}: {done} of {total}")
        )

    brdfs: list[Brdf] = []
    fields: list[Field] = []
    inside: list[Inside] = []
    others: list[Brdf] = []
    names, planned = ("", ""), None
    for which, wavelength in enumerate(wavelengths):
        begin("particles", which)
        file = scene_of(at(content, wavelength), "brdf", task.folder)
        inside.append(Inside(names_of(content), tuple(layer.phase_matrix for layer in file.scene.layers)))
        keywords = keywords_of(file)
        with file.located():
            planned = planned or planned_of(file, keywords)
            brdfs.append(brdf(file.scene, **keywords, progress=begin("BRDF, Fourier orders", which)))
        elsewhere, names = other_base(file.scene)
        if elsewhere is not None:  # its reflectance is wanted alone
            others.append(brdf(elsewhere, **{**keywords, "mu_o": 1.0, "phi": 0.0, "transmission": False}))
        if with_field:
            known = iter(file.particles.values())  # in place of `vrte.spheres`: what has been worked out, in that order
            file = scene_of(at(content, wavelength), "field", task.folder, lambda *_, known=known, **__: next(known))
            with file.located():
                fields.append(radiance(file.scene, **keywords_of(file), progress=begin("field inside", which)))
    return Outcome(
        content,
        tuple(wavelengths) if content.get("wavelength_um") is not None else (),
        tuple(with_scene(one, text) for one in brdfs),
        tuple(with_scene(one, text) for one in fields),
        tuple(inside),
        planned,
        reflectances=reflectances(wavelengths, brdfs, others, names),
    )


def names_of(content: Content) -> tuple[str, ...]:
    """What the layers hold, in words."""
    return tuple(f"layer {place}: {filling(layer)}" for place, layer in enumerate(content["layer"], 1))


def filling(layer: Content) -> str:
    """What a layer holds.

    >>> filling({"particles": {"gold": 1, "rutile": 2}}), filling({"phase": {"henyey_greenstein": 0.9}})
    ('gold + rutile', 'henyey_greenstein 0.9')
    """
    held: Any = next(layer[key] for key in FILLINGS if key in layer)
    if "phase" not in layer:
        return shown_key(held) if isinstance(held, str) else " + ".join(map(shown_key, held))
    return str(held) if isinstance(held, str) else " ".join(f"{key} {value}" for key, value in held.items())


def planned_of(file: SceneFile, keywords: dict[str, Any]) -> Planned | None:
    """The plan of the BRDF; only discrete ordinates have one."""
    if keywords.get("method", EXACT) not in (EXACT, AUTO):
        return None
    made = plan("brdf", file.scene, **keywords)
    facts = made.as_dict()
    parts = list(facts["parts"].values()) if "parts" in facts else [facts]
    left_out = dict.fromkeys(text for part in parts for text in part["left_out"].values())
    return Planned(str(made), tuple(left_out), tuple(dict.fromkeys(text for part in parts for text in part["shared"])))


def read(task: Read) -> Outcome:
    """A result file, through a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="vrte-view-") as folder:
        path = Path(folder) / f"result{task.suffix}"
        path.write_bytes(task.data)
        try:
            found = load(path)
        except SceneError as error:
            raise SceneError(str(error).replace(str(path), "the file")) from error
    return outcome_of(found)


def outcome_of(found: Brdf | Field | Spectrum) -> Outcome:
    """A result as something to see."""
    if isinstance(found, Spectrum):
        wavelengths = found.wavelength_um.tolist()
        content, shares = scene_in(found[0], wavelengths), reflectances(wavelengths, found.brdfs)
        return Outcome(content, tuple(wavelengths), found.brdfs, opened=True, reflectances=shares)
    content = scene_in(found)
    if isinstance(found, Brdf):
        return Outcome(content, brdfs=(found,), opened=True, reflectances=reflectances((), (found,)))
    one_beam(found)
    return Outcome(content, fields=(found,), opened=True)


def scene_in(result: Brdf | Field, wavelengths: list[float] | None = None) -> Content | None:
    """The content of the scene file that a result tells of, where it does and the page can take it."""
    text = result.diagnostics.get(SCENE)
    if not isinstance(text, str):
        return None
    try:
        content = toml_content(text)
        if wavelengths:
            content["wavelength_um"] = wavelengths
        return adopted(content)
    except SceneError:
        return None


def write_tensor(task: Tensor, tell: Tell) -> Written:
    """Mitsuba's file, solved for the directions that it needs."""
    from vrte.formats.measured_polarized import directions, write_mitsuba

    stage = "BRDF at the directions of the tensor"
    found = spectrum(
        task.content,
        wavelengths_of(task.content),
        lambda done, total: tell(Progress(0.9 * done / max(total, 1), stage)),
        task.folder,
        **directions(),
    )
    tell(Progress(0.9, "writing the tensor"))
    return Written("brdf.bsdf", bytes_written("brdf.bsdf", lambda path: write_mitsuba(found, path)))
