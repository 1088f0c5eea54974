"""A sweep from its file to its table: begun or taken up, computed by an engine, finished."""

import math
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vrte.basics import cost
from vrte.basics.arrays import check_choice, check_number, check_whole
from vrte.basics.errors import SceneError, warn_user
from vrte.basics.running import Progress, count_usable_cpus, keep_to_one_thread
from vrte.calls.plan import warn_runtime_of_all
from vrte.formats.atomic import check_file_name
from vrte.request.how import PRECISIONS, complete_docstring
from vrte.request.request import Request
from vrte.sweep import store
from vrte.sweep.chunks import Shared, collect_warnings, perform, prepare, solve_on_device
from vrte.sweep.engines import ENGINES, perform_on_threads
from vrte.sweep.results import TABLE, Sample, make_scene_request
from vrte.sweep.store import Work
from vrte.sweep.table import SUFFIXES, Grid, choose_chunk_size, cut_grid, open_table
from vrte.sweep.template import Sweep, list_particle_places, list_shared_particles, make_scene_at, read_sweep

if TYPE_CHECKING:
    import xarray

MOST_WORKERS = 4096
LARGEST_ZARR_CHUNK = 2e9  # bytes: beyond, its codecs refuse


class SweepWarning(UserWarning):
    """What the scenes of a sweep warned of, and those that failed: one of each kind stands for all."""


@complete_docstring
def sweep(
    source: str | os.PathLike[str] | Mapping[str, Any],
    output: str | os.PathLike[str] | None = None,
    engine: str = "threads",
    scheduler: str | None = None,
    workers: int | None = None,
    chunk: int | None = None,
    progress: Progress | None = None,
    time_limit_s: float | None = None,
    precision: str | None = None,
) -> "xarray.Dataset":
    """The Mueller BRDFs, the Stokes fields, or the appearance, of many scenes, as one labelled table.

    Parameters
    ----------
    source : path or mapping
        A sweep file or its content: a scene for `vrte brdf` or `vrte field`, or with a table [appearance] in their
        place, and a table [axes] (docs/how_to/sweeps.md).
    output : path, optional
        Ends in .zarr (for large tables) or .nc; without it the table is made in memory.
    engine : str
        "threads", "dask" or "opencl".
    scheduler : str, optional
        Address of a Dask cluster; without it "dask" has one of its own on this machine.
    workers : int, optional
        Cores or worker processes, all there are by default.
    chunk : int, optional
        How many scenes are computed, written and kept in memory together.
    {progress}
    time_limit_s : float, optional
        A sweep whose scenes that are left are predicted to take longer is refused; without it none is. Above 20 seconds
        one LongSolveWarning has their time.
    precision : {'auto', 'double', 'single'}, optional
        With engine "opencl", as for `vrte.brdf`; it wins over the file's.

    Returns
    -------
    xarray.Dataset
        With the axes as coordinates and the variables of `vrte.Brdf.to_xarray`, or of `vrte.Field.to_xarray` with mu0
        as a dimension and stokes_parameter as the last, or with the quantities of an appearance; ``error`` says of a
        scene without result, whose numbers are NaN, what was wrong with it. With ``output`` the data are read from
        there when they are asked for. Called again after whatever stopped it, it goes on with the chunks that are left;
        a complete table is looked over and opened, and what is damaged is made again. Warns (SweepWarning) where
        scenes failed or warned, and of damage.

    Raises
    ------
    SceneError
        For bad input, or another sweep than the output was begun with.
    SweepError
        Where another process is at the same output, or the cluster is lost.
    {DeviceError, MissingExtraError, OSError}

    Examples
    --------
    >>> import vrte
    >>> layer = {"phase": "rayleigh", "albedo": 1.0, "thickness": 1.0}
    >>> axes = {"depth": {"key": "layer[1].thickness", "values": [0.1, 1.0]}, "base.albedo": [0.0, 1.0]}
    >>> base = {"kind": "lambertian", "albedo": 0.0}
    >>> scene = {"nodes": 4, "layer": [layer], "base": base, "brdf": {"mu_i": 0.5, "mu_o": 1.0}}
    >>> table = vrte.sweep({**scene, "axes": axes}, workers=1)
    >>> dict(table.reflectance.sizes), bool(abs(table.reflectance.sel({"base.albedo": 1.0}) - 1.0).max() < 1e-12)
    ({'depth': 2, 'base.albedo': 2, 'mu_i': 1}, True)
    """
    check_choice("engine", engine, ENGINES)
    if scheduler is not None and engine != "dask":
        raise SceneError("scheduler goes with engine 'dask' only")
    if scheduler is not None and workers is not None:
        raise SceneError("workers are those of the scheduler: leave one of the two out")
    limit = math.inf if time_limit_s is None else check_number("time_limit_s", time_limit_s, 0.0, math.inf, "seconds")
    count = count_usable_cpus() if workers is None else check_whole("workers", workers, 1, MOST_WORKERS)
    given = read_sweep(source)
    if precision is not None:
        chosen = {"precision": check_choice("precision", precision, PRECISIONS)}
        given = replace(given, template=given.template | chosen)
    if engine != "opencl" and given.template.get("precision", "auto") != "auto":
        raise SceneError("precision goes with engine 'opencl' only", "precision")
    if engine == "opencl" and given.kind == TABLE:
        words = "an appearance is read by 'threads' or 'dask'"
        raise SceneError(f"engine 'opencl' makes tables of BRDFs and fields: {words}")
    engine_of = partial(run_engine, engine=engine, scheduler=scheduler, workers=count)
    # a device's speed is not known
    predict = None if engine == "opencl" else partial(predict_sweep, workers=count, limit=limit)
    if output is not None:
        path = Path(check_file_name(output)).absolute()
        if path.suffix not in SUFFIXES:
            raise SceneError(f"the output {path.name} must end in {' or '.join(SUFFIXES)}")
        if not path.parent.is_dir():
            raise SceneError(f"the output {path} lies in a folder that does not exist: {path.parent}")
        return make_table(given, path, chunk, predict, engine_of, progress)
    with tempfile.TemporaryDirectory(prefix="vrte-sweep-") as folder:
        output = Path(folder) / "table.zarr"
        return make_table(given, output, chunk, predict, engine_of, progress, on_disk=False).load()


def make_table(
    given: Sweep,
    output: Path,
    chunk: int | None,
    predict: Callable[[Work], None] | None,
    engine_of: Callable[[Work, set[int]], Iterator[int]],
    progress: Progress | None,
    on_disk: bool = True,
) -> "xarray.Dataset":
    """The table at ``output``, computed as far as it is not there; ``on_disk``, so that a power cut cannot harm it."""
    with store.lock_output(output) as folder:
        damage: list[str] = []
        try:
            if os.path.lexists(output):
                damage = store.check_output(given, output, folder)
                if not damage:
                    store.clear(folder)
                    return open_table(output)
            grid = choose_grid(given, output, chunk)
            work, more = store.resume_work(folder, given, grid, output)
            if chunk is not None and work.grid.box != grid.box:
                raise SceneError("chunk must be left as it was: the table was begun with chunks of another size")
        except BaseException:
            if not (folder / store.BEGUN).is_file():
                store.clear(folder)
            raise
        if damage or more:
            words = ", ".join(dict.fromkeys(damage + more))
            warn_user(f"{output} was damaged; made again: {words}", SweepWarning)
        if predict is not None:
            with keep_to_one_thread():
                predict(work)
        compute(work, engine_of, progress)
        report(work)
        store.finish(work, output, on_disk)
    return open_table(output)


def choose_grid(given: Sweep, output: Path, chunk: int | None) -> Grid:
    """The grid of the sweep, cut into chunks. Raises SceneError where a chunk or the whole is too large."""
    size = store.describe_sweep_results(given).bytes_of_a_scene
    scenes = choose_chunk_size(given.count, size) if chunk is None else check_whole("chunk", chunk, 1, given.count)
    if scenes * size > LARGEST_ZARR_CHUNK:
        raise SceneError(f"a chunk of {scenes} scenes holds {scenes * size / 1e9:.1f} GB, at most 2 GB are allowed")
    free = shutil.disk_usage(output.parent).free
    if given.count * size > free:
        raise SceneError(
            f"{given.count} scenes of {size / 1e6:.3g} MB make a table of {given.count * size / 1e9:.3g} GB, "
            f"and {output.parent} has room for {free / 1e9:.3g} GB"
        )
    return cut_grid(given.shape, scenes)


def predict_sweep(work: Work, workers: int, limit: float) -> None:
    """Warns how long the scenes left take on so many workers. Raises SceneError beyond the limit [s]."""
    grid, done = work.grid, work.done()
    left = [chunk for chunk in range(grid.chunks) if chunk not in done]
    if not left:
        return
    scenes = sum(math.prod(grid.extent(chunk)) for chunk in left)
    shared = list(list_shared_particles(work.sweep))
    own = len(shared) < len(work.sweep.template.get("particles", {}))  # particles that no other scene has
    solves = work.sweep.asked.solves if work.sweep.kind == TABLE else 1  # of a scene

    def make_request_at(number: int) -> tuple[Request, float]:
        index = number // solves
        chunk = left[index * len(left) // scenes]
        there = list(grid.places(chunk))
        where = there[-1 if index == scenes - 1 else index % len(there)]
        begin = time.perf_counter()
        with collect_warnings({}):
            found = make_scene_at(work.sweep, where, work.optics.keep, at_one=True)
            request = found.make_request() if isinstance(found, Sample) else make_scene_request(found)
        seconds = (time.perf_counter() - begin) * work.sweep.wavelengths / solves
        return replace(request, threads=1), seconds if own else 0.0

    beside = 0.0 if done else measure_particle_seconds(work, shared)
    what = f"{scenes} scenes on {workers} worker{'s'[: workers > 1]}"
    try:
        warn_runtime_of_all(scenes * solves, make_request_at, what, limit, beside, workers)
    except SceneError:
        if not done:
            store.clear(work.folder)
        raise


def measure_particle_seconds(work: Work, shared: list[tuple[str, tuple[int, ...]]]) -> float:
    """Seconds for all particles that scenes share, by the last of each name, at the last wavelength, kept."""
    seconds, begin = 0.0, time.perf_counter()
    for name, lengths in shared:
        index = tuple(length - 1 for length in lengths)
        for wavelength in sorted({0, work.sweep.wavelengths - 1}):
            start = time.perf_counter()
            prepare(work, Shared(name, index, wavelength))
        seconds += math.prod(lengths) * work.sweep.wavelengths * (time.perf_counter() - start)
        if time.perf_counter() - begin > cost.LOOKING:
            break
    return seconds


def compute(work: Work, engine_of: Callable[[Work, set[int]], Iterator[int]], progress: Progress | None) -> None:
    """Computes all chunks that are not done yet."""
    done = work.done()
    if len(done) == work.grid.chunks:
        return
    scenes = sum(math.prod(work.grid.extent(chunk)) for chunk in done)
    report_progress = progress or (lambda done, total: None)
    report_progress(scenes, work.sweep.count)
    # once for all chunks: BLAS threads that come and go between them keep the cores busy with waiting
    with keep_to_one_thread(), closing(engine_of(work, done)) as finished:  # type: ignore[type-var]
        for count in finished:
            scenes += count
            if count:
                report_progress(scenes, work.sweep.count)


def run_engine(work: Work, done: set[int], engine: str, scheduler: str | None, workers: int) -> Iterator[int]:
    """Number of scenes of each piece of work, as it is finished: first the particles that scenes share, then chunks."""
    particles = (Shared(*which) for which in list_particle_places(work.sweep))
    chunks = (chunk for chunk in range(work.grid.chunks) if chunk not in done)
    if engine == "dask":
        from vrte.sweep.engines import perform_on_cluster

        yield from perform_on_cluster(work, (particles, chunks), scheduler, workers)
        return
    yield from perform_on_threads(work, particles, workers, workers)
    if engine == "opencl":
        yield from (perform(work, chunk, solve_on_device, "opencl") for chunk in chunks)  # all scenes of one together
    else:
        yield from perform_on_threads(work, chunks, work.grid.chunks - len(done), workers)


def report(work: Work) -> None:
    """Warns once of each kind of warning, and once of all scenes that failed."""
    failures: list[str] = []
    kinds: dict[str, tuple[int, str]] = {}
    for _, record in work.records():
        failures += record["failed"].values()
        for kind, (count, message) in record["warnings"].items():
            before = kinds.get(kind, (0, message))
            kinds[kind] = (before[0] + count, before[1])
    for count, message in kinds.values():
        more = f" (and {count - 1} more like it)" if count > 1 else ""
        warn_user(f"{message}{more}", SweepWarning)
    if failures:
        warn_user(f"{len(failures)} of {work.sweep.count} scenes failed; the first said: {failures[0]}", SweepWarning)
