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
from typing import Any, BinaryIO

from vrte.app.form import adopted, at, keywords_of, scene_text, wavelengths_of
from vrte.app.messages import Failure, Inside, Message, Outcome, Planned, Progress, Read, Solve, Task, Tensor, Written
from vrte.app.reflectance import other_base, reflectances
from vrte.basics.arrays import in_one_line
from vrte.basics.errors import AccuracyError, DeviceError, MissingExtraError, SceneError
from vrte.basics.limits import limit_memory
from vrte.calls.brdf import brdf
from vrte.calls.plan import plan
from vrte.calls.radiance import radiance
from vrte.calls.spectrum import spectrum
from vrte.formats import load
from vrte.formats.scene_file import FILLINGS, SceneFile, scene_of, toml_content
from vrte.formats.toml_table import shown_key
from vrte.request.request import EXACT
from vrte.results.brdf import Brdf
from vrte.results.field import Field, one_beam
from vrte.results.spectrum import SCENE, Spectrum

Tell = Callable[[Message], None]
MOST_NAMED = 30  # warnings


def main() -> None:
    """Reads a task, answers, ends."""
    output = own_output()
    task: Task = pickle.load(sys.stdin.buffer)
    threading.Thread(target=end_with_input, daemon=True).start()
    limit_memory(task.memory_bytes)
    lock = threading.Lock()

    def tell(message: Message) -> None:
        with lock:
            pickle.dump(message, output, protocol=pickle.HIGHEST_PROTOCOL)
            output.flush()

    tell(answered(task, tell))
    os._exit(0)  # at once: nothing is left to do, and threads of the linear algebra may be waiting


def own_output() -> BinaryIO:
    """The standard output for messages alone: what anything prints goes to standard error."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return output


def end_with_input() -> None:
    """Ends the process when nobody waits for it any more."""
    sys.stdin.buffer.read()
    os._exit(1)


def answered(task: Task, tell: Tell) -> Outcome | Written | Failure:
    """What comes of a task; any error is a sentence."""
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UserWarning)
            found = tensor(task, tell) if isinstance(task, Tensor) else done(task, tell)
    except (SceneError, AccuracyError, DeviceError, MissingExtraError, OSError) as error:
        return Failure(in_one_line(str(error), 1000))
    except MemoryError:
        return Failure("not enough memory for this scene: fewer directions, nodes or wavelengths need less")
    except Exception as error:  # never seen; a page must not wait for ever
        return Failure(in_one_line(f"{type(error).__name__}: {error}", 1000))
    if isinstance(found, Written):
        return found
    notes = dict.fromkeys(str(one.message) for one in caught if issubclass(one.category, UserWarning))
    return replace(found, notes=tuple(notes)[:MOST_NAMED])


def done(task: Solve | Read, tell: Tell) -> Outcome:
    """What there is to see."""
    return solved(task, tell) if isinstance(task, Solve) else read(task)


def solved(task: Solve, tell: Tell) -> Outcome:
    """The BRDF at every wavelength, and the field where it is asked for."""
    content = task.content
    wavelengths = wavelengths_of(content)
    with_field = "field" in content
    count, stages = len(wavelengths), 3 if with_field else 2
    steps = (Progress(step / (count * stages), "") for step in range(count * stages))

    def part(stage: str, which: int) -> Callable[[int, int], None]:
        """Progress within one step of one wavelength."""
        begin, where = next(steps).share, f" at {wavelengths[which]:g} um" if count > 1 else ""
        tell(Progress(begin, f"{stage}{where}"))
        return lambda done, total: tell(
            Progress(begin + done / max(total, 1) / (count * stages), f"{stage}{where}: {done} of {total}")
        )

    brdfs: list[Brdf] = []
    fields: list[Field] = []
    inside: list[Inside] = []
    others: list[Brdf] = []
    names = ("", "")
    planned = None
    for which, wavelength in enumerate(wavelengths):
        part("particles", which)
        file = scene_of(at(content, wavelength), "brdf", task.folder)
        inside.append(Inside(names_of(content), tuple(layer.phase_matrix for layer in file.scene.layers)))
        planned = planned or planned_of(file, tell)
        brdfs.append(checked(file, lambda call, tick: brdf(call, **tick), part("BRDF, Fourier orders", which)))
        elsewhere, names = other_base(file.scene)
        if elsewhere is not None:
            asked = {**keywords_of(file), "mu_o": 1.0, "phi": 0.0, "transmission": False}  # its reflectance is wanted
            others.append(brdf(elsewhere, **asked))
        if with_field:
            known = particles_of(file, content)
            file = scene_of(at(content, wavelength), "field", task.folder, known)
            fields.append(checked(file, lambda call, tick: radiance(call, **tick), part("field inside", which)))
    text = scene_text(content)
    return Outcome(
        content,
        tuple(wavelengths) if content.get("wavelength_um") is not None else (),
        tuple(with_scene(one, text) for one in brdfs),
        tuple(with_scene(one, text) for one in fields),
        tuple(inside),
        planned,
        reflectances=reflectances(wavelengths, brdfs, others, names),
    )


def with_scene(result: Any, text: str) -> Any:
    """A result that says in its diagnostics of what scene it is: files made of it tell, too."""
    return replace(result, diagnostics={**result.diagnostics, SCENE: text})


def checked(file: SceneFile, solve: Callable[[Any, dict[str, Any]], Any], tick: Callable[[int, int], None]) -> Any:
    """A solve, complained about by the keys of the form."""
    with file.located():
        return solve(file.scene, {**keywords_of(file), "progress": tick})


def particles_of(file: SceneFile, content: dict[str, Any]) -> Callable[..., Any]:
    """In place of `vrte.spheres`, for the same particles in the same order: what has been worked out."""
    found = iter(file.particles.values())
    return lambda *_, **__: next(found)


def names_of(content: dict[str, Any]) -> tuple[str, ...]:
    """What the layers hold, in words."""
    return tuple(f"layer {place}: {filling(layer)}" for place, layer in enumerate(content["layer"], 1))


def filling(layer: dict[str, Any]) -> str:
    """What a layer holds.

    >>> filling({"particles": {"gold": 1, "rutile": 2}}), filling({"phase": {"henyey_greenstein": 0.9}})
    ('gold + rutile', 'henyey_greenstein 0.9')
    """
    held: Any = next(layer[key] for key in FILLINGS if key in layer)
    if "phase" not in layer:
        return shown_key(held) if isinstance(held, str) else " + ".join(map(shown_key, held))
    return str(held) if isinstance(held, str) else " ".join(f"{key} {value}" for key, value in held.items())


def planned_of(file: SceneFile, tell: Tell) -> Planned | None:
    """The plan of the BRDF, told before it is carried out; only discrete ordinates have one."""
    keywords = keywords_of(file)
    if keywords.get("method", EXACT) not in (EXACT, "auto"):
        return None
    with file.located():
        made = plan("brdf", file.scene, **keywords)
    facts = made.as_dict()
    parts = list(facts["parts"].values()) if "parts" in facts else [facts]
    found = Planned(
        str(made),
        tuple(dict.fromkeys(text for part in parts for text in part["left_out"].values())),
        tuple(dict.fromkeys(text for part in parts for text in part["shared"])),
        max(part["memory_bytes"] for part in parts),
        sum(part["operations"] for part in parts),
    )
    tell(found)
    return found


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


def scene_in(result: Brdf | Field, wavelengths: list[float] | None = None) -> dict[str, Any] | None:
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


def tensor(task: Tensor, tell: Tell) -> Written:
    """Mitsuba's file, solved for the directions that it needs."""
    from vrte.formats.measured_polarized import directions, write_mitsuba

    content = task.content
    wavelengths = wavelengths_of(content)
    found = spectrum(
        content,
        wavelengths,
        lambda done, total: tell(Progress(0.9 * done / max(total, 1), "BRDF at the directions of the tensor")),
        task.folder,
        **directions(),
    )
    tell(Progress(0.9, "writing the tensor"))
    with tempfile.TemporaryDirectory(prefix="vrte-view-") as folder:
        path = Path(folder) / "brdf.bsdf"
        write_mitsuba(found, path)
        return Written("brdf.bsdf", path.read_bytes())
