"""`vrte brdf` and `vrte field`: a scene file in, result files out, and lines on what was computed, of what, and how."""

import argparse
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from vrte import __version__
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.running import Run
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.calls.spectrum import prepare_scenes, solve_spectrum, vary_files
from vrte.commands.common import label_errors, report_written, show_progress
from vrte.formats.contents import Result
from vrte.formats.result_file import save, write_csv
from vrte.formats.scene_family import SceneFamily
from vrte.formats.scene_file import SceneFile, read_content, read_listed_wavelengths, read_scene
from vrte.pictures.figures import save_figure
from vrte.request.how import EXACT, OPTIONS, PHOTONS
from vrte.results.brdf import Brdf, Spectrum, add_scene_text, check_ascending
from vrte.results.field import Field
from vrte.results.over_hemisphere import check_directions


def describe(path: Path, files: Sequence[SceneFile], result: Result) -> None:
    """Prints what was computed of a scene file."""
    refracts = any(file.scene.has_interfaces for file in files)
    what = "field" if isinstance(result, Field) else "BRDF"
    print(f"vrte {__version__}: {'' if refracts else 'subsurface '}{what} of {path}")
    if isinstance(result, Spectrum):
        describe_wavelengths(files, result, refracts)
    else:
        describe_scene(files[0], refracts)
        describe_result(result)


def describe_scene(file: SceneFile, refracts: bool) -> None:
    """Particles, layers, interfaces and base, a line each."""
    scene = file.scene
    lines = [f"{name}: {particles.description}" for name, particles in file.particles.items()]
    for place, (layer, index) in enumerate(zip(scene.layers, scene.indices, strict=True)):
        lines += [one.in_words for one in scene.interfaces[place : place + 1] if one]
        matrix, medium = layer.phase_matrix, f", in index {index:g}" if refracts else ""
        lines.append(
            f"layer {place + 1}: optical thickness {layer.thickness:g}, single-scattering albedo {layer.albedo:.6g}, "
            f"asymmetry {matrix.asymmetry:.4f}, {matrix.terms} terms{medium}"
        )
    lines += [one.in_words for one in scene.interfaces[-1:] if one]
    base = "black" if scene.base is None else str(scene.base)
    lines.append(f"base: {base}{'' if scene.base_is_reached else ', which no light reaches'}")
    for line in lines:
        print(f"  {line}")


def describe_result(result: Brdf | Field) -> None:
    """How a result was found, and what is in it, a line each."""
    made = result.diagnostics
    where = f"OpenCL device {made['device']}" if "device" in made else f"{made['threads']} threads"
    orders = f", {made['orders']} Fourier orders" if "orders" in made else ""
    print(f"  {result!r}\n  {made['method']}, {describe_effort([made])}{orders}, {where}")
    describe_derivatives(result, made)
    lines = [made["method_rule"]] if "method_rule" in made else []
    if made["method"] == EXACT:
        lines.append(f"by {made['algorithm']} ({made['algorithm_rule']})")
        lines.append(f"truncation: {made['truncation']} ({made['truncation_rule']})")
        if made["orders_repeated"]:
            lines.append(f"{len(made['orders_repeated']['orders'])} orders repeated by {made['orders_repeated']['by']}")
    lines += [describe_agreement(made["agreement"])] if "agreement" in made else []
    lines += [describe_photons(made["photons"])] if "photons" in made else []
    if isinstance(result, Brdf):
        diffuse = "" if result.specular is None else ", diffuse"
        lines.append(f"directional-hemispherical reflectance{diffuse}: {list_shares(result.reflectance, result.mu_i)}")
        if result.specular_reflectance is not None:
            lines.append(f"mirrored as a beam, and not in it: {list_shares(result.specular_reflectance, result.mu_i)}")
        if result.surface is not None:
            lines.append("with what rough surfaces send back without any particle, which is in surface as well")
        if result.coherent is not None:
            added = list_shares(result.coherent[:, 0, 0], result.mu_i)
            lines.append(f"interference adds to f00 [1/sr] straight back: {added}")
    elif result.index is not None:
        lines.append(f"depths in media of index {', '.join(f'{index:g}' for index in np.unique(result.index))}")
    for line in lines:
        print(f"  {line}")


def describe_wavelengths(files: Sequence[SceneFile], result: Spectrum, refracts: bool) -> None:
    """Prints reflectance, media and layers of a spectrum, one line for each wavelength."""
    print(f"  {result!r}")
    mirrored = result.specular_reflectance
    columns = f"R at mu_i {result.mu_i[0]:<6g}" + ("" if mirrored is None else "  mirrored        ")
    media = "media: indices from top to bottom; " if refracts else ""
    print(f"  {'um':>8}  {columns}  {media}layers: optical thickness, albedo, asymmetry")
    for place, (wavelength, file, one) in enumerate(zip(result.wavelength_um, files, result, strict=True)):
        scene = file.scene
        layers = "; ".join(
            f"{each.thickness:.5g}, {each.albedo:.6f}, {each.phase_matrix.asymmetry:.4f}" for each in scene.layers
        )
        shares = f"{one.reflectance[0]:<16.6f}" + ("" if mirrored is None else f"  {mirrored[place, 0]:<16.6f}")
        indices = ", ".join(f"{index:.6g}" for index in (scene.index_above, *scene.indices, scene.index_below))
        print(f"  {wavelength:8.6g}  {shares}  {f'{indices}; ' if refracts else ''}{layers}")
    describe_derivatives(result, result[0].diagnostics)
    made = [one.diagnostics for one in result]
    print(f"  {made[0]['method']}, {describe_effort(made)}")


def describe_effort(made: Sequence[dict[str, Any]]) -> str:
    """The nodes of results by a method, fewest to most, or the photons of one that has no nodes."""
    name, words = ("nodes", "nodes") if "nodes" in made[0] else ("photons_per_beam", "photons a beam")
    counts = sorted({one[name] for one in made})
    return f"{' to '.join(map(str, dict.fromkeys((counts[0], counts[-1]))))} {words}"


def describe_derivatives(result: Any, made: dict[str, Any]) -> None:
    """The largest of each derivative of f00 or of I, of which radiance, and how it was found; one line each."""
    for name, values in (result.jacobian or {}).items():
        is_field = isinstance(result, Field)
        of = np.abs(result.stokes if is_field else result.mueller[..., 0])[..., 0].max(initial=0.0)
        largest = np.abs(values if is_field else values[..., 0])[..., 0].max(initial=0.0)
        what, unit = ("I", "W/m2/sr") if is_field else ("f00", "1/sr")
        how = made["derivatives"][name]
        print(f"  derivative with {name}: {what} by at most {largest:.4g} {unit} a unit, of {of:.4g} ({how})")


def list_shares(shares: Array, mu_i: Array) -> str:
    """The first few fractions of light, and at which cosines they are."""
    shown = ", ".join(f"{share:.4f} at mu_i {mu:g}" for share, mu in zip(shares[:6], mu_i[:6], strict=True))
    return f"{shown}{', ...' if mu_i.size > 6 else ''}"


def describe_agreement(found: dict[str, Any]) -> str:
    """What `verify` found, in words."""
    if not found["orders_compared"]:
        return f"{found['with']} cannot verify any order: nothing to compare"
    flux = "" if found["flux"] is None else f", {found['flux']:.1e} in flux"
    agreed = f"{found['with']} agrees to {found['radiance']:.1e} in radiance{flux}"
    return f"{agreed} ({found['orders_compared']} orders compared)"


def describe_photons(found: dict[str, Any]) -> str:
    """How far photons are from the light that was found, in words."""
    off = ", ".join(f"{name} {found[name]:.1f}" for name in "IQUV")
    return f"{found['photons']} photons a beam: off by {off} standard errors at most, of {found['noise']:.1e}"


def print_times(clock: dict[str, dict[str, float]], result: Result) -> None:
    """A table of wall seconds by name, and of thread seconds of the solver's stages, all wavelengths added up."""
    stages = Run(1)
    for one in result if isinstance(result, Spectrum) else [result]:
        for stage, took in one.diagnostics["stages"].items():
            stages.record(stage, took["wall_seconds"], took["thread_seconds"])
    print(f"\n  {'stage':22}{'wall s':>9}{'thread s':>10}")
    for name, took in clock.items():
        print(f"  {name:22}{took['wall_seconds']:9.3f}")
        for stage, times in stages.stages.items() if name == "solver" else ():
            print(f"    {stage:20}{times['wall_seconds']:9.3f}{times['thread_seconds']:10.3f}")
    print(f"  {'total':22}{sum(took['wall_seconds'] for took in clock.values()):9.3f}\n")


HOW = tuple(name for name in OPTIONS if name != "settings")  # options that win over the scene file


def read_setting(text: str) -> tuple[str, Any]:
    """Name and value of a method's setting, "orders=3" or "boundary=mark": a number where it is one."""
    name, sign, value = text.partition("=")
    if not (name and sign):
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, not {text!r}")
    for read in (int, float):
        with suppress(ValueError):
            return name, read(value)
    return name, value


def check(options: argparse.Namespace) -> None:
    """Whether options go together and something is written; wavelengths from the file. Raises SceneError."""
    vars(options).setdefault("wavelengths_um", None)  # which `vrte field` does not have
    if not (options.output or options.csv or options.plot):
        raise SceneError("nothing to write: -o, --csv or --plot names a file for the result")
    if options.kind == "field":
        return
    if options.wavelengths_um is None:
        with label_errors(options.scene, reading=True):
            listed = read_listed_wavelengths(read_content(options.scene))
            options.wavelengths_um = listed and check_ascending(listed).tolist()


def run(options: argparse.Namespace) -> None:
    asked = {name: getattr(options, name) for name in (*HOW, "side") if getattr(options, name, None) is not None}
    if options.photons and options.verify:
        raise SceneError("--verify and --photons are two checks: ask for one of them", "verify")
    asked |= {"verify": PHOTONS} if options.photons else {}
    asked |= {"settings": dict(options.set)} if options.set else {}
    asked |= {"coherent": True} if getattr(options, "coherent", False) else {}
    clock, paths = Run(1), list[Path]()
    with show_progress() as (phase, tick):
        phase("particles")
        with clock.timed("particles"), label_errors(options.scene, reading=True):
            files, solve = (prepare_several if options.wavelengths_um else prepare)(options, asked, tick)
        phase("wavelengths" if options.wavelengths_um else "Fourier orders, then directions")
        with clock.timed("solver"):
            result = solve()
    describe(options.scene, files, result)
    writers = {"output": save, "csv": write_csv, "plot": lambda result, path: save_figure(result.plot(), path)}
    for name, write in writers.items():
        if (path := getattr(options, name)) is not None:
            with clock.timed(f"writing {path.suffix}"):
                write(result, path)
            paths.append(path)
    print_times(clock.stages, result)
    for path in paths:
        report_written(path)


def prepare(
    options: argparse.Namespace, asked: dict[str, Any], tick: Any
) -> tuple[list[SceneFile], Callable[[], Result]]:
    """The scene at the wavelength of its file, and what solves it."""
    file = read_scene(options.scene, options.kind)
    variations = SceneFamily(options.scene, options.derivatives).variations() if options.derivatives else None
    if options.plot and file.kind == "brdf":
        check_directions(file.request["mu_o"], file.request.get("phi", 0.0))

    def solve() -> Result:
        call: Callable[..., Brdf | Field] = brdf if file.kind == "brdf" else radiance
        with file.located():
            found = call(file.scene, progress=tick, derivatives=variations, **file.keywords(asked))
        return add_scene_text(found, file.text)

    return [file], solve


def prepare_several(
    options: argparse.Namespace, asked: dict[str, Any], tick: Any
) -> tuple[list[SceneFile], Callable[[], Result]]:
    """The scenes at several wavelengths, and what solves them."""
    at = np.array(options.wavelengths_um)
    files, warned = prepare_scenes(options.scene, at, progress=tick, asked=asked)
    variations = vary_files(options.scene, at, options.derivatives or None)
    return files, lambda: solve_spectrum(files, at, tick, warned, variations, **asked)
