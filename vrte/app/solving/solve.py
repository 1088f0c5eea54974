"""Tasks of the viewer that are answered once: a scene is solved, a result, a part or a stranger's scene is read."""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vrte.app.form import content as form
from vrte.app.form.checks import PartRead, adopt_with_notes, parse_content, read_link, select_part
from vrte.app.form.content import Content
from vrte.app.solving.tab_session import collect_bytes, read_bytes
from vrte.app.solving.worker import Adopted, Exchange, Outcome, Planned, Progress, Reflectances, Written
from vrte.appearance.colours import convert_to_hex
from vrte.appearance.hiding import Conditions
from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.errors import MissingExtraError, Place, SceneError
from vrte.calls.brdf import brdf
from vrte.calls.plan import plan
from vrte.calls.radiance import radiance
from vrte.formats import load
from vrte.formats.layers import describe_filling
from vrte.formats.particle_sources import check_particles
from vrte.formats.scene_file import SceneFile, make_scene_file
from vrte.formats.toml_table import parse_toml, write_toml
from vrte.optics.angle_tables import describe_expansion
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.request.how import AUTO, EXACT
from vrte.results.brdf import SCENE, Brdf, Spectrum, add_scene_text
from vrte.results.field import Field, require_one_beam
from vrte.scene.boundary import Lambertian
from vrte.scene.scene import Scene

MOST_WORDS = 1500  # characters about a part
FEWEST, FROM_UM, TO_UM = 5, 0.46, 0.64  # wavelengths that make a colour: so many, from below the one to above the other
WITH_BEAM, WITHOUT_BEAM = ", all of it", ", without what is mirrored as a beam"
LAST_ORDER = 0.9  # of a stage: where the bar is once all Fourier orders are solved


def solve(exchange: Exchange, content: Content, folder: Path) -> Outcome:
    """The BRDF at every wavelength, and the field where it is asked for."""
    wavelengths, text = form.list_page_wavelengths(content), write_toml(content)
    with_field = "field" in content
    stages = ("particles", "BRDF", "BRDF over another base", *(["field inside"] if with_field else []))
    count = len(wavelengths) * len(stages)

    def begin(stage: str, which: int) -> Callable[[int, int], None]:
        """Progress within one stage of one wavelength: what remains after its last Fourier order takes time, too."""
        step = which * len(stages) + stages.index(stage)
        where = f" at {wavelengths[which]:g} µm" if len(wavelengths) > 1 else ""
        exchange.report(Progress(step / count, f"{stage}{where}"))

        def progress(done: int, total: int) -> None:
            words = f"Fourier orders, {done} of {total}" if done < total else "adding up"
            exchange.report(Progress((step + LAST_ORDER * done / max(total, 1)) / count, f"{stage}{where}: {words}"))

        return progress

    brdfs: list[Brdf] = []
    fields: list[Field] = []
    inside: list[dict[str, PhaseMatrix]] = []
    others: list[Brdf] = []
    names, planned = ("", ""), None
    for which, wavelength in enumerate(wavelengths):
        begin("particles", which)
        alone = form.select_wavelength(content, wavelength)
        file = make_scene_file(alone, "brdf", folder)
        inside.append(list_phase_matrices(content, file.scene))
        keywords = form.choose_keywords(file)
        with file.located():
            planned = planned or make_plan_message(file, keywords)
            brdfs.append(brdf(file.scene, **keywords, progress=begin("BRDF", which)))
        elsewhere, names = replace_base(file.scene)
        if elsewhere is not None:  # its reflectance is wanted alone
            asked = {**keywords, "mu_o": 1.0, "phi": 0.0, "transmission": False, "coherent": False}
            others.append(brdf(elsewhere, **asked, progress=begin("BRDF over another base", which)))
        if with_field:
            file = replace(make_scene_file(alone, "field", folder, check_particles), scene=file.scene)
            with file.located():
                fields.append(radiance(file.scene, **form.choose_keywords(file), progress=begin("field inside", which)))
    return Outcome(
        content,
        tuple(wavelengths) if content.get("wavelength_um") is not None else (),
        tuple(add_scene_text(one, text) for one in brdfs),
        tuple(add_scene_text(one, text) for one in fields),
        tuple(inside),
        planned,
        notes=exchange.notes(),
        reflectances=collect_reflectances(wavelengths, brdfs, others, names),
    )


def look_at_part(exchange: Exchange, content: Content, folder: Path, place: Place) -> PartRead:
    """What a part is that is made from a file, at the first and the last wavelength."""
    wavelengths = form.list_page_wavelengths(content)
    words = []
    for wavelength in dict.fromkeys((wavelengths[0], wavelengths[-1])):
        alone = form.select_wavelength(select_part(content, place), wavelength)
        try:
            scene = make_scene_file(alone, "brdf", folder).scene
        except SceneError as error:
            text = str(error).replace(f"{folder}{os.sep}", "")  # its path is private
            return PartRead(message=put_in_one_line(text, 1000), place=error.place or place)
        made: Any = scene.base if place[0] == "base" else scene.layers[int(place[1])].phase_matrix
        if isinstance(made, PhaseMatrix) and made.expansion is not None:
            words.append("; ".join(f"{name}: {value}" for name, value in describe_expansion(made).items()))
        else:
            words.append(made.in_words if isinstance(made, PhaseMatrix) else str(made))
    return PartRead("; ".join(exchange.notes(before=words))[:MOST_WORDS])


def list_phase_matrices(content: Content, scene: Scene) -> dict[str, PhaseMatrix]:
    """Phase matrices by what the layers hold, in words, without the non-scattering ones between interfaces."""
    tables = content["layer"]
    called = zip(form.name_layers(tables), tables, strict=True)
    names = [f"{name}: {describe_filling(one)}" for name, one in called if not form.is_interface(one)]
    added = len(scene.layers) - len(names)
    matrices = []
    for layer in scene.layers:
        if added and layer.thickness == layer.albedo == 0.0 and layer.phase_matrix.terms == 1:
            added -= 1
        else:
            matrices.append(layer.phase_matrix)
    return dict(zip(names, matrices, strict=True))


def make_plan_message(file: SceneFile, keywords: dict[str, Any]) -> Planned | None:
    """The plan of the BRDF; only discrete ordinates have one."""
    if keywords.get("method", EXACT) not in (EXACT, AUTO):
        return None
    made = plan("brdf", file.scene, **keywords)
    facts = made.as_dict()
    parts = list(facts["parts"].values()) if "parts" in facts else [facts]
    left_out = dict.fromkeys(text for part in parts for text in part["left_out"].values())
    shared = dict.fromkeys(text for part in parts for text in part["shared"])
    return Planned(str(made), tuple(left_out), tuple(shared))


def read(exchange: Exchange, data: bytes, folder: Path, suffix: str) -> Outcome:
    """A result file, by its bytes: whatever is in them harms this process alone."""
    return replace(make_outcome(read_bytes(data, suffix, load)), notes=exchange.notes())


def replace_base(scene: Scene) -> tuple[Scene | None, tuple[str, str]]:
    """The scene over black, or over white where it lies on black, and both names; None where no base is reached."""
    if not scene.base_is_reached:
        return None, ("no base is reached", "")
    if scene.base is None:
        return replace(scene, base=Lambertian(1.0)), ("over black", "over white (albedo 1)")
    albedo = f" (albedo {scene.base.even_albedo:g})" if scene.base.orders_reflected == 1 else ""
    return replace(scene, base=None), (f"over the base{albedo}", "over black")


def collect_reflectances(
    wavelength_um: Sequence[float],
    brdfs: Sequence[Brdf],
    others: Sequence[Any] = (),
    names: Sequence[str] = ("as in the file",),
) -> Reflectances | None:
    """Reflectances of ``brdfs`` by wavelength, and of ``others`` over other bases, with ``names``; or None."""
    if not brdfs:
        return None
    found = (brdfs, others) if len(others) == len(brdfs) else (brdfs,)
    curves: dict[str, Array] = {}
    for name, each in zip(names, found, strict=False):
        diffuse = np.array([one.reflectance for one in each])
        if each[0].specular is None:
            curves[name] = diffuse
        else:
            curves[f"{name}{WITH_BEAM}"] = diffuse + np.array([one.specular[:, 0, 0] for one in each])
            curves[f"{name}{WITHOUT_BEAM}"] = diffuse
    colours, why_none = compute_colours(np.array(wavelength_um), curves)
    return Reflectances(brdfs[0].mu_i, curves, colours, why_none)


def compute_colours(wavelength_um: Array, curves: dict[str, Array]) -> tuple[dict[str, tuple[str, ...]], str]:
    """Colours (mu_i,) of curves (wavelength, mu_i) in sunlight, white where the reflectance is 1; or why none."""
    if wavelength_um.size < FEWEST or wavelength_um[0] > FROM_UM or wavelength_um[-1] < TO_UM:
        ends = f"from {FROM_UM:g} µm or less to {TO_UM:g} µm or more"
        return {}, f"A colour needs at least {FEWEST} wavelengths, {ends}: type 0.4:0.7:9."
    from vrte.render.sky import make_film, weigh_wavelengths

    try:
        weighed = weigh_wavelengths(wavelength_um)
    except MissingExtraError as error:
        return {}, str(error)
    exposed = make_film(weighed.sum(axis=1))
    return {name: tuple(map(convert_to_hex, exposed((weighed @ curve).T))) for name, curve in curves.items()}, ""


def make_outcome(found: Any) -> Outcome:
    """A result, BRDF, field or spectrum, as something to see."""
    wavelengths = found.wavelength_um.tolist() if isinstance(found, Spectrum) else []
    brdfs = found.brdfs if isinstance(found, Spectrum) else (found,) if isinstance(found, Brdf) else ()
    fields = () if brdfs else (found,)
    for field in fields:
        require_one_beam(field)
    content, reflectances = recover_scene((*brdfs, *fields)[0], wavelengths), collect_reflectances(wavelengths, brdfs)
    return Outcome(content, tuple(wavelengths), brdfs, fields, opened=True, reflectances=reflectances)


def recover_scene(result: Brdf | Field, wavelengths: list[float]) -> Content | None:
    """The content of the scene file that a result holds, where it does and the page can take it."""
    text = result.diagnostics.get(SCENE)
    if not isinstance(text, str):
        return None
    try:
        content = parse_toml(text)
        if wavelengths:
            content["wavelength_um"] = wavelengths
        return adopt_with_notes(content)[0]
    except SceneError:
        return None


def write_tensor(exchange: Exchange, content: Content, folder: Path, wavelengths_um: Sequence[float]) -> Written:
    """Mitsuba's file, solved for the directions that it needs."""
    from vrte.exports.export import export

    def progress(done: int, total: int) -> None:
        exchange.report(Progress(0.9 * done / max(total, 1), "BRDF at the directions of the tensor"))

    def write(path: Path) -> None:
        export(content, path, wavelengths_um, diffuse=True, progress=progress, folder=folder)

    return Written("brdf.pbsdf", collect_bytes("brdf.pbsdf", write))


def write_report(exchange: Exchange, content: Content, folder: Path, suffix: str, viewing: Conditions) -> Written:
    """The page or the sheet of the paint, as `vrte paint` writes it."""
    from vrte.app.solving.appearance import LEFT_OUT
    from vrte.appearance.paint import paint

    def progress(done: int, total: int) -> None:
        exchange.report(Progress(0.98 * done / max(total, 1), "reading off the paint"))

    asked = {key: value for key, value in content.items() if key == "base" or key not in LEFT_OUT}
    light = viewing.illuminant, viewing.observer, viewing.white
    found = paint(asked, None, *light, progress=progress, folder=folder)
    return Written(f"paint{suffix}", collect_bytes(f"paint{suffix}", found.save))


def adopt(exchange: Exchange, given: bytes | str, folder: Path, names: frozenset[str]) -> Adopted:
    """A stranger's scene, a file's bytes or a link's text, as the form takes it."""
    content = read_link(given) if isinstance(given, str) else parse_content(given)
    return Adopted(*adopt_with_notes(content, folder, names, aside=True))
