"""Several wavelengths on the command line, and the table for Mitsuba that is made of five of them."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vrte import __version__
from vrte.basics.errors import SceneError
from vrte.calls.mitsuba import solve_for_table
from vrte.calls.spectrum import prepare_scenes, solve_spectrum
from vrte.commands.common import (
    Found,
    Seconds,
    Tick,
    check_output,
    label_errors,
    label_reading_errors,
    read_wavelengths,
)
from vrte.formats import measured_polarized as mitsuba
from vrte.formats.contents import Result
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
                f"--mitsuba needs {mitsuba.WAVELENGTHS} wavelengths, by --wavelengths-um or in the scene file"
            )
        mitsuba.check_wavelengths(options.wavelengths_um)


def solve(
    options: argparse.Namespace, asked: dict[str, Any], seconds: Seconds, phase: Callable[[str], None], tick: Tick
) -> Found:
    """All that was asked for at the wavelengths."""
    at = np.array(options.wavelengths_um)
    phase("particles")
    with seconds.of("particles"), label_reading_errors(options.scene):
        files, told = prepare_scenes(options.scene, at, progress=tick, asked=asked)
    phase("wavelengths")
    with seconds.of("solver"), label_errors(options.scene):
        result = solve_spectrum(files, at, tick, told, **asked)
    if not options.mitsuba:
        return Found(files, result)
    phase("directions of the table")
    with seconds.of("solver for Mitsuba"), label_errors(options.scene):
        return Found(files, result, solve_for_table(files, at, tick, **asked))


def write_table(table: tuple[Spectrum, Spectrum], options: argparse.Namespace, seconds: Seconds) -> Path:
    """The file for Mitsuba."""
    with seconds.of("writing .bsdf"):
        errors = mitsuba.write_mitsuba(table[0], options.mitsuba, options.mitsuba_step_deg, table[1])
    print(f"  Mitsuba's table: {errors}")
    path: Path = options.mitsuba
    return path


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
    print(f"vrte {__version__}: subsurface BRDF of {path}")
    print(f"  {found.result!r}")
    mu_i = found.result.mu_i[0]
    print(f"  {'um':>8}  R at mu_i {mu_i:<6g}  layers: optical thickness, albedo, asymmetry")
    for wavelength, file, one in zip(found.result.wavelength_um, found.files, found.result, strict=True):
        layers = "; ".join(
            f"{layer.thickness:.5g}, {layer.albedo:.6f}, {layer.phase_matrix.asymmetry:.4f}"
            for layer in file.scene.layers
        )
        print(f"  {wavelength:8.6g}  {one.reflectance[0]:<16.6f}  {layers}")
    nodes = {one.diagnostics["nodes"] for one in found.result}
    some = f"{min(nodes)} to {max(nodes)}" if len(nodes) > 1 else f"{min(nodes)}"
    print(f"  {found.result[0].diagnostics['method']}, {some} nodes")
