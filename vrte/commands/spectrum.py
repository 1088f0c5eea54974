"""Several wavelengths on the command line, and the table for Mitsuba that is made of five of them."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vrte import __version__
from vrte.basics.errors import SceneError
from vrte.calls.mitsuba import check_below_surface, check_nested, solve_for_table, take_off_surface
from vrte.calls.spectrum import prepare_scenes, solve_spectrum, vary_files
from vrte.commands.common import (
    Found,
    Seconds,
    Tick,
    check_output,
    label_errors,
    label_reading_errors,
    read_wavelengths,
    tell_derivatives,
)
from vrte.formats import measured_polarized as mitsuba
from vrte.formats.contents import Result
from vrte.formats.mitsuba_scene import write_nested_scene
from vrte.formats.scene_file import read_content, read_listed_wavelengths
from vrte.results.spectrum import Spectrum, check_ascending


def add_options(command: argparse.ArgumentParser) -> None:
    """What `vrte brdf` takes for several wavelengths."""
    command.add_argument(
        "--wavelengths-um",
        metavar="UM,UM,...",
        type=read_wavelengths,
        help="ascending; they win over the scene file, and particles are worked out anew at each",
    )
    command.add_argument(
        "--mitsuba",
        metavar="OUT.bsdf",
        type=Path,
        help="a table for Mitsuba 3, measured_polarized, of exactly five wavelengths",
    )
    command.add_argument(
        "--mitsuba-step-deg",
        metavar="DEG",
        type=float,
        default=mitsuba.STEP,
        help=f"step of its angles theta; default: {mitsuba.STEP:g}",
    )
    command.add_argument(
        "--mitsuba-nested",
        action="store_true",
        help="the table of what lies below the smooth surface on top, and OUT.xml with Mitsuba's own surface above it",
    )


def read_file_wavelengths(path: Path) -> list[float] | None:
    """The scene file's wavelengths, ascending, where it lists several. Raises SceneError, OSError."""
    with label_reading_errors(path):
        listed = read_listed_wavelengths(read_content(path))
        return listed and check_ascending(listed).tolist()


def check_options(options: argparse.Namespace) -> None:
    """Whether they go together, before the work is done. Raises SceneError."""
    if options.mitsuba:
        check_output(options.mitsuba, ".bsdf")
        mitsuba.make_angles(options.mitsuba_step_deg)
        if not options.wavelengths_um:
            raise SceneError(
                f"--mitsuba needs {mitsuba.WAVELENGTHS} wavelengths, by --wavelengths-um or in the scene file",
                "mitsuba",
            )
        mitsuba.check_wavelengths(options.wavelengths_um)
        if options.mitsuba_nested:
            check_nested(options.mitsuba, {"illuminate": options.illuminate or "top"})
    elif options.mitsuba_nested:
        raise SceneError("--mitsuba-nested goes with --mitsuba", "mitsuba")


def solve(
    options: argparse.Namespace, asked: dict[str, Any], seconds: Seconds, phase: Callable[[str], None], tick: Tick
) -> Found:
    """All that was asked for at the wavelengths."""
    at = np.array(options.wavelengths_um)
    phase("particles")
    with seconds.of("particles"), label_reading_errors(options.scene):
        files, told = prepare_scenes(options.scene, at, progress=tick, asked=asked)
        variations = vary_files(options.scene, at, options.derivatives or None)
    phase("wavelengths")
    with seconds.of("solver"), label_errors(options.scene):
        result = solve_spectrum(files, at, tick, told, variations, **asked)
    if not options.mitsuba:
        return Found(files, result)
    phase("directions of the table")
    with seconds.of("solver for Mitsuba"), label_errors(options.scene):
        surface, below = take_off_surface(files) if options.mitsuba_nested else (None, files)
        table = solve_for_table(below, at, tick, **asked)
        if surface:
            check_below_surface(table[0])
        return Found(files, result, table, surface)


def write_table(found: Found, options: argparse.Namespace, seconds: Seconds) -> list[Path]:
    """The files for Mitsuba."""
    assert found.table is not None
    table, exact = found.table
    paths: list[Path] = [options.mitsuba]
    with seconds.of("writing .bsdf"):
        errors = mitsuba.write_mitsuba(table, options.mitsuba, options.mitsuba_step_deg, exact)
    print(f"  Mitsuba's table: {errors}")
    if table.specular is not None:
        print(f"  Mitsuba's table: {mitsuba.describe_beam(table)}")
    if found.surface:
        paths.append(options.mitsuba.with_suffix(".xml"))
        write_nested_scene(paths[1], paths[0], *found.surface)
        print("  Mitsuba's table: of what lies below the surface, which Mitsuba's own dielectric is")
    return paths


def sum_stages(result: Result) -> dict[str, dict[str, float]]:
    """Seconds of each stage, those of all wavelengths added up."""
    found: dict[str, dict[str, float]] = {}
    for one in result if isinstance(result, Spectrum) else [result]:
        for stage, took in one.diagnostics["stages"].items():
            before = found.setdefault(stage, dict.fromkeys(took, 0.0))
            found[stage] = {name: before[name] + value for name, value in took.items()}
    return found


def describe(path: Path, found: Found) -> None:
    """What was computed, of what, and how: one line a wavelength."""
    refracts = any(file.scene.has_interfaces for file in found.files)
    print(f"vrte {__version__}: {'' if refracts else 'subsurface '}BRDF of {path}")
    print(f"  {found.result!r}")
    mu_i, mirrored = found.result.mu_i[0], found.result.specular_reflectance
    columns = f"R at mu_i {mu_i:<6g}" + ("" if mirrored is None else "  mirrored        ")
    media = "media: indices from top to bottom; " if refracts else ""
    print(f"  {'um':>8}  {columns}  {media}layers: optical thickness, albedo, asymmetry")
    for place, (wavelength, file, one) in enumerate(
        zip(found.result.wavelength_um, found.files, found.result, strict=True)
    ):
        layers = "; ".join(
            f"{layer.thickness:.5g}, {layer.albedo:.6f}, {layer.phase_matrix.asymmetry:.4f}"
            for layer in file.scene.layers
        )
        shares = f"{one.reflectance[0]:<16.6f}" + ("" if mirrored is None else f"  {mirrored[place, 0]:<16.6f}")
        indices = (file.scene.index_above, *file.scene.indices, file.scene.index_below)
        inside = f"{', '.join(f'{index:.6g}' for index in indices)}; " if refracts else ""
        print(f"  {wavelength:8.6g}  {shares}  {inside}{layers}")
    tell_derivatives(found.result, found.result[0].diagnostics)
    nodes = {one.diagnostics["nodes"] for one in found.result}
    some = f"{min(nodes)} to {max(nodes)}" if len(nodes) > 1 else f"{min(nodes)}"
    print(f"  {found.result[0].diagnostics['method']}, {some} nodes")
