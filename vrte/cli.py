"""The command `vrte`: a scene file in, result files out.

Exit code 0, 1 for a failure, 2 for bad input, 130 for an interrupt; every error is one line on standard error.
"""

import argparse
import importlib.util
import math
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from vrte import __version__, brdf, radiance
from vrte.backends import BACKENDS
from vrte.brdf import Brdf
from vrte.discrete_ordinates.choice import ALGORITHMS
from vrte.errors import AccuracyError, DeviceError, MissingExtraError, SceneError
from vrte.field import Field
from vrte.formats.csv_table import write_csv
from vrte.formats.scene_file import SceneFile, read_scene
from vrte.illumination import SIDES
from vrte.optics.refractive_index import MATERIALS, refractive_index
from vrte.optics.truncation import CHOICES
from vrte.request import AUTO, COARSEST, EXACT, FINEST, METHODS, MOST_NODES

HOW = ("nodes", "accuracy", "truncation")  # options that win over the scene file
OUTPUTS = (("output", ".nc"), ("csv", ".csv"), ("plot", ".png"))
EXTRAS = (("output", "files", ("xarray", "h5netcdf")), ("plot", "plot", ("matplotlib",)))
Tick = Callable[[int, int], None]


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line, by default this process's own; returns the exit code.

    >>> main(["material", "water", "--wavelength-um", "nonsense"])
    Traceback (most recent call last):
    SystemExit: 2
    """
    options = _parser().parse_args(arguments)
    try:
        with _termination_cleans_up(), _warnings_in_one_line():
            options.run(options)
            sys.stdout.flush()
    except KeyboardInterrupt:
        return _complain("interrupted", 130)
    except BrokenPipeError:
        # whoever read our output has gone: nobody is left to tell, and the flush at exit would fail again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except SceneError as error:
        return _complain(str(error), 2)
    except (AccuracyError, DeviceError, MissingExtraError, OSError) as error:
        return _complain(str(error), 1)
    except MemoryError:
        return _complain("not enough memory for this scene: fewer directions or nodes need less", 1)
    return 0


def _complain(message: str, code: int) -> int:
    print(f"vrte: error: {' '.join(message.split())}", file=sys.stderr)
    return code


class _Parser(argparse.ArgumentParser):
    """Complains in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"vrte: error: {message} (see `{self.prog} --help`)\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="vrte", description="Polarized subsurface reflectance of particulate layers.")
    parser.add_argument("--version", action="version", version=f"vrte {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_solve(commands, "brdf", "the Mueller BRDF of a scene")
    _add_solve(commands, "field", "the Stokes field inside and above a scene")
    material = commands.add_parser("material", help="the refractive index of a material; without a name, all names")
    material.add_argument("name", nargs="?", help='a name, or a path in the database such as "main/Au/Johnson"')
    material.add_argument("--wavelength-um", type=float, metavar="UM", help="wavelength in vacuum [micrometres]")
    material.set_defaults(run=_material)
    _add_stability(commands)
    _add_tables(commands)
    _add_report(commands)
    devices = commands.add_parser("devices", help="OpenCL platforms and devices, and which one is taken")
    devices.add_argument("--measure", action="store_true", help="products a second, beside BLAS; some seconds")
    devices.set_defaults(run=_devices)
    return parser


def _add_stability(commands: Any) -> None:
    help_text = "stiff and extreme scenes, solved and checked, as a table"
    command = commands.add_parser("stability", help=help_text, description=f"Computes {help_text}.")
    command.add_argument(
        "-o", "--output", metavar="FOLDER", type=Path, default=Path("stability"), help="made if absent"
    )
    command.add_argument("--quick", action="store_true", help="some forty small scenes instead of all")
    command.add_argument("--fresh", action="store_true", help="forget what an earlier run has finished")
    command.add_argument("--algorithm", choices=ALGORITHMS, default="auto", help="of discrete ordinates; default: auto")
    command.add_argument("--cases", metavar="PATTERN", default="*", help='names, such as "rayleigh*N=8"; default: all')
    command.add_argument("--threads", metavar="N", type=_whole(1, 1024), help="default: all CPUs that may be used")
    command.set_defaults(run=_stability)


def _add_tables(commands: Any) -> None:
    help_text = "the tables and figures of the GPU paper, measured on this machine"
    command = commands.add_parser("tables", help=help_text, description=f"Computes {help_text}.")
    command.add_argument(
        "--figures", action="store_true", help="figures 2 to 9 instead: how the cost grows, with exponents"
    )
    command.add_argument(
        "--configurations", metavar="C,C,...", help='such as "1,2,5"; default: all that this machine can run'
    )
    command.add_argument("-o", "--output", metavar="FOLDER", type=Path, default=Path("tables"), help="made if absent")
    command.add_argument("--quick", action="store_true", help="few small scenes instead of the paper's: seconds")
    command.add_argument("--threads", metavar="N", type=_whole(1, 1024), default=2, help="of OpenMP; default: 2")
    command.set_defaults(run=_tables)


def _add_report(commands: Any) -> None:
    help_text = "error against run time of every method, measured on this machine"
    command = commands.add_parser("report", help=help_text, description=f"Computes {help_text}.")
    command.add_argument(
        "--figures", action="store_true", help="figures 1 and 2 of the radiance-factor paper instead: seconds"
    )
    command.add_argument("-o", "--output", metavar="FOLDER", type=Path, default=Path("report"), help="made if absent")
    command.add_argument("--quick", action="store_true", help="three small scenes instead of all: seconds")
    command.add_argument("--fresh", action="store_true", help="forget what an earlier run has finished")
    command.add_argument("--scenes", metavar="PATTERN", default="*", help='names, such as "Rayleigh*"; default: all')
    command.set_defaults(run=_report)


def _add_solve(commands: Any, kind: str, help_text: str) -> None:
    command = commands.add_parser(kind, help=help_text, description=f"Computes {help_text}.")
    command.add_argument("scene", metavar="SCENE.toml", type=Path)
    command.add_argument("-o", "--output", metavar="OUT.nc", type=Path, required=True, help="NetCDF")
    command.add_argument("--csv", metavar="OUT.csv", type=Path, help="one row a direction")
    command.add_argument("--plot", metavar="OUT.png", type=Path, help="a picture")
    command.add_argument("--threads", metavar="N", type=_whole(1, 1024), help="default: all CPUs that may be used")
    command.add_argument("--algorithm", choices=ALGORITHMS, default="auto", help="of discrete ordinates; default: auto")
    command.add_argument("--backend", choices=BACKENDS, default="openmp", help="what computes; default: openmp")
    command.add_argument(
        "--truncation", choices=CHOICES, help="of phase matrices with more than 2 N terms; default: auto"
    )
    command.add_argument("--accuracy", metavar="A", type=_accuracy, help="relative to the largest I at each depth")
    command.add_argument(
        "--nodes",
        metavar="N",
        type=_whole(1, MOST_NODES),
        help="in each hemisphere; this, too, wins over the scene file",
    )
    command.add_argument("--illuminate", choices=SIDES, default="top", help="where the light comes from; default: top")
    command.add_argument(
        "--method",
        choices=(*METHODS, AUTO),
        default=EXACT,
        help=f"default: {EXACT}; {AUTO}: by rule, for the accuracy; others: docs/methods.md",
    )
    command.add_argument(
        "--set",
        metavar="NAME=VALUE",
        type=_setting,
        action="append",
        default=[],
        help="a setting of the method, any number of times",
    )
    command.add_argument("--verify", action="store_true", help="solve by both algorithms and report their agreement")
    command.set_defaults(run=_solve, kind=kind)


def _whole(low: int, high: int) -> Callable[[str], int]:
    """What reads a whole number of an option."""

    def read(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"must be a whole number from {low} to {high}, not {text!r}")
        return int(text)

    return read


def _setting(text: str) -> tuple[str, Any]:
    """Name and value of a method's setting: a number where it is one, otherwise a word."""
    name, sign, value = text.partition("=")
    if not (name and sign):
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, not {text!r}")
    for read in (int, float):
        try:
            return name, read(value)
        except ValueError:
            continue
    return name, value


def _accuracy(text: str) -> float:
    """What an answer may be wrong by."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not FINEST <= value <= COARSEST:
        raise argparse.ArgumentTypeError(f"must be a number between {FINEST:g} and {COARSEST:g}, not {text!r}")
    return value


def _material(options: argparse.Namespace) -> None:
    if options.name is None:
        for name, entry in MATERIALS.items():
            print(f"{name:12}{' and '.join(entry.pages)}: {entry.reason}")
        return
    if options.wavelength_um is None:
        raise SceneError("--wavelength-um is missing: an index depends on the wavelength")
    index = refractive_index(options.name, options.wavelength_um)
    print(f"{options.name} at {options.wavelength_um:g} um: n = {index.n:.6g}, k = {index.k:.6g}")
    print(f"from {index.source}")


def _devices(options: argparse.Namespace) -> None:
    from vrte.cl import device
    from vrte.report import devices
    from vrte.running import usable_cpus

    found = device.devices()
    try:
        taken, reason = device.choose(found, device.wanted())
    except DeviceError:
        print(devices.as_text(found, None, "for the reason below"), flush=True)
        raise
    print(devices.as_text(found, taken, reason))
    if options.measure:
        with device.device_errors(), _progress() as (phase, tick):
            phase("products")
            rates = devices.measure(device.session(), usable_cpus(), tick)
        print(f"\n{devices.rates_as_text(rates, usable_cpus())}")


def _solve(options: argparse.Namespace) -> None:
    _check_outputs(options)
    seconds: dict[str, float] = {}
    with _progress() as (phase, tick):
        phase("particles")
        with _timed(seconds, "particles"):
            file = _read(options.scene, options.kind)
        _check_picture(options, file)
        phase("Fourier orders, then directions")
        with _timed(seconds, "solver"):
            result = _run(file, options, tick)
    _describe(options.scene, file, result)
    written = [_write(result, options, name, seconds) for name, _ in OUTPUTS if getattr(options, name)]
    _print_times(seconds, result.diagnostics["stages"])
    for path in written:
        print(f"wrote {path} ({path.stat().st_size / 1e3:,.0f} kB)")


def _stability(options: argparse.Namespace) -> None:
    from vrte.report import stability

    cases = stability.matching(options.cases, options.quick)
    folder = _made_folder(options.output)
    how = stability.Options(options.algorithm, options.threads)
    with _progress() as (phase, tick):
        records = stability.run_cases(cases, folder, how, options.fresh, _told(phase, tick))
    print(stability.as_text(records))
    print()
    settings = f"{'quick, ' if options.quick else ''}cases {options.cases}, algorithm {options.algorithm}"
    for path in stability.write_tables(records, folder, settings):
        print(f"wrote {path} ({path.stat().st_size / 1e3:,.0f} kB)")
    stability.require_all(records)


def _tables(options: argparse.Namespace) -> None:
    if options.figures and options.configurations is not None:
        raise SceneError("--configurations goes with the tables, not with --figures")
    (_cost_figures if options.figures else _paper_tables)(options)


def _paper_tables(options: argparse.Namespace) -> None:
    from vrte.report import tables
    from vrte.report.cost import OthersClock, require_pictures

    chosen, refused = tables.chosen(options.configurations)
    require_pictures()
    folder, rounds = _made_folder(options.output), tables.ROUNDS_QUICK if options.quick else tables.ROUNDS
    with _progress() as (phase, tick), tables.started(each.simd for each in chosen) as children:
        others = OthersClock(lambda: sum(child.cpu_seconds for child in children.values()))
        found = tables.measure(
            children, tables.problems(options.quick), chosen, options.threads, rounds, _told(phase, tick)
        )
        facts = tables.facts(children, chosen)
    busy = others.statement()
    print(tables.as_text(found))
    print("".join(f"  {text}\n" for text in [*(f"not measured: {reason}" for reason in refused), busy]))
    settings = f"{'quick, ' if options.quick else ''}{rounds} rounds, OpenMP on {options.threads} threads; {busy}"
    for path in [tables.write_figure(found, folder), *tables.write_page(found, folder, settings, facts, refused)]:
        print(f"wrote {path} ({path.stat().st_size / 1e3:,.0f} kB)")
    tables.require_all(found)


def _report(options: argparse.Namespace) -> None:
    (_radiance_factor_figures if options.figures else _report_on_methods)(options)


def _report_on_methods(options: argparse.Namespace) -> None:
    from vrte.report import methods
    from vrte.report.cost import OthersClock

    names, curves = methods.matching(options.scenes, options.quick), methods.curves(options.quick)
    methods.require_page()
    folder, pace = _made_folder(options.output), methods.HASTE if options.quick else methods.FULL
    with _progress() as (phase, tick):
        others = OthersClock()
        rows = methods.measure(names, curves, folder, pace, _told(phase, tick), options.fresh)
    print(methods.as_text(rows))
    settings = f"{'quick, ' if options.quick else ''}one thread; {others.statement()}"
    for path in [folder / methods.CSV, *methods.write_page(rows, folder, settings)]:
        print(f"wrote {path} ({path.stat().st_size / 1e3:,.0f} kB)")


def _radiance_factor_figures(options: argparse.Namespace) -> None:
    from vrte.report import radiance_factor

    for path in radiance_factor.write_figures(_made_folder(options.output)):
        print(f"wrote {path} ({path.stat().st_size / 1e3:,.0f} kB)")


def _told(phase: Callable[[str], None], tick: Tick) -> Callable[[int, int, str], None]:
    """One call for both: what begins, and how much is done."""

    def told(done: int, total: int, name: str) -> None:
        phase(name)
        tick(done, total)

    return told


def _cost_figures(options: argparse.Namespace) -> None:
    from vrte.report import cost

    configurations = cost.configurations(options.threads)
    cost.require_pictures()
    axes, folder = cost.axes(options.quick), _made_folder(options.output)
    seconds_a_point = cost.SECONDS_A_POINT_QUICK if options.quick else cost.SECONDS_A_POINT
    with _progress() as (phase, tick):
        others = cost.OthersClock()
        measurements = cost.measure(axes, configurations, seconds_a_point, _told(phase, tick))
    busy = others.statement()
    names = [configuration.name for configuration in configurations]
    print(cost.as_text(measurements, axes, names))
    said = "; ".join([busy, *(f"not measured: {reason}" for reason in cost.left_out())])
    print(f"  {said}\n")
    settings = f"{'quick, ' if options.quick else ''}{' against '.join(names)}; {said}"
    written = cost.write_figures(measurements, axes, names, folder)
    for path in [*written, *cost.write_page(measurements, axes, names, folder, settings)]:
        print(f"wrote {path} ({path.stat().st_size / 1e3:,.0f} kB)")


def _made_folder(folder: Path) -> Path:
    """A folder to write in, made if absent."""
    if folder.exists() and not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise SceneError(f"the output {folder} must be a folder that can be written in")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _check_outputs(options: argparse.Namespace) -> None:
    """Whatever would fail after the work is done, as far as it can be seen before."""
    given = [(getattr(options, name), suffix) for name, suffix in OUTPUTS if getattr(options, name)]
    for path, suffix in given:
        if path.suffix.lower() != suffix:
            raise SceneError(f"the output {path} must end in {suffix}")
        if not path.parent.is_dir():
            raise SceneError(f"the output {path} lies in a folder that does not exist: {path.parent}")
        if path.is_dir() or not os.access(path.parent, os.W_OK):
            raise SceneError(f"the output {path} cannot be written: {_obstacle(path)}")
    for option, extra, modules in EXTRAS:
        if getattr(options, option) and any(importlib.util.find_spec(module) is None for module in modules):
            raise MissingExtraError(f"writing {getattr(options, option)}", extra)


def _obstacle(path: Path) -> str:
    return "it is a folder" if path.is_dir() else f"no permission to write in {path.parent}"


def _read(path: Path, kind: str) -> SceneFile:
    try:
        return read_scene(path, kind)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from error
    except OSError as error:
        raise SceneError(f"{path}: {error.strerror or error}") from error


def _check_picture(options: argparse.Namespace, file: SceneFile) -> None:
    if options.plot and file.kind == "brdf":
        from vrte.report.lobes import check_directions

        check_directions(file.request["mu_o"], file.request.get("phi", 0.0))


def _run(file: SceneFile, options: argparse.Namespace, tick: Tick) -> Brdf | Field:
    solve: Callable[..., Brdf | Field] = brdf if file.kind == "brdf" else radiance
    how = file.options | {
        name: getattr(options, name) for name in ("threads", "algorithm", "verify", "backend", "method", "illuminate")
    }
    how["settings"] = dict(options.set)
    how |= {name: getattr(options, name) for name in HOW if getattr(options, name) is not None}
    try:
        return solve(file.scene, **file.request, progress=tick, **how)
    except SceneError as error:
        raise SceneError(f"{options.scene}: {file.located(str(error))}") from error


def _write(result: Brdf | Field, options: argparse.Namespace, name: str, seconds: dict[str, float]) -> Path:
    path: Path = getattr(options, name)
    with _timed(seconds, f"writing {path.suffix}"):
        if name == "output":
            result.save(path)
        elif name == "csv":
            write_csv(result, path)
        else:
            from vrte.report.lobes import save_plot

            save_plot(result, path)
    return path


def _describe(path: Path, file: SceneFile, result: Brdf | Field) -> None:
    """What was computed, of what, and how."""
    print(f"vrte {__version__}: subsurface {'BRDF' if isinstance(result, Brdf) else 'field'} of {path}")
    for name, particles in file.particles.items():
        print(f"  {name}: {particles.description}")
    for place, layer in enumerate(file.scene.layers, 1):
        matrix = layer.phase_matrix
        print(
            f"  layer {place}: optical thickness {layer.thickness:g}, single-scattering albedo {layer.albedo:.6g}, "
            f"asymmetry {matrix.asymmetry:.4f}, {matrix.terms} terms"
        )
    base = "black" if file.scene.base is None else str(file.scene.base)
    print(f"  base: {base}{'' if file.scene.base_is_reached else ', which no light reaches'}")
    made = result.diagnostics
    print(f"  {result!r}")
    where = f"OpenCL device {made['device']}" if "device" in made else f"{made['threads']} threads"
    orders = f", {made['orders']} Fourier orders" if "orders" in made else ""
    print(f"  {made['method']}, {made['nodes']} nodes{orders}, {where}")
    if "method_rule" in made:
        print(f"  {made['method_rule']}")
    if made["method"] == EXACT:
        _describe_plan(made)
    if "agreement" in made:
        print(f"  {_agreement(made['agreement'])}")
    if isinstance(result, Brdf):
        shown = ", ".join(
            f"{r:.4f} at mu_i {mu:g}" for r, mu in zip(result.reflectance[:6], result.mu_i[:6], strict=True)
        )
        print(f"  directional-hemispherical reflectance: {shown}{', ...' if result.mu_i.size > 6 else ''}")


def _describe_plan(made: dict[str, Any]) -> None:
    """How discrete ordinates went about it."""
    print(f"  by {made['algorithm']} ({made['algorithm_rule']})")
    print(f"  truncation: {made['truncation']} ({made['truncation_rule']})")
    if made["orders_repeated"]:
        print(f"  {len(made['orders_repeated']['orders'])} orders repeated by {made['orders_repeated']['by']}")


def _agreement(found: dict[str, Any]) -> str:
    """What `verify` found, in words."""
    if not found["orders_compared"]:
        return f"{found['with']} cannot vouch for any order: nothing to compare"
    flux = "" if found["flux"] is None else f", {found['flux']:.1e} in flux"
    agreed = f"{found['with']} agrees to {found['radiance']:.1e} in radiance{flux}"
    return f"{agreed} ({found['orders_compared']} orders compared)"


def _print_times(seconds: dict[str, float], stages: dict[str, dict[str, float]]) -> None:
    """A table of wall seconds, and of seconds summed over the threads for the stages of the solver."""
    print(f"\n  {'stage':22}{'wall s':>9}{'thread s':>10}")
    for name, wall in seconds.items():
        print(f"  {name:22}{wall:9.3f}")
        if name == "solver":
            for stage, took in stages.items():
                print(f"    {stage:20}{took['wall_seconds']:9.3f}{took['thread_seconds']:10.3f}")
    print(f"  {'total':22}{sum(seconds.values()):9.3f}\n")


@contextmanager
def _timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    start = time.perf_counter()
    yield
    seconds[name] = time.perf_counter() - start


@contextmanager
def _progress() -> Iterator[tuple[Callable[[str], None], Tick]]:
    """Two calls, one names what begins and one ticks: a bar on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda _: None, lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        yield (
            lambda name: bar.update(task, description=name),
            lambda done, total: bar.update(task, completed=done, total=total),
        )


@contextmanager
def _termination_cleans_up() -> Iterator[None]:
    """Lets SIGTERM unwind the stack, so that half-written files go; only a main thread may ask for that."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _warnings_in_one_line() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = lambda message, *_, **__: print(f"vrte: warning: {message}", file=sys.stderr)
        yield


if __name__ == "__main__":
    sys.exit(main())
