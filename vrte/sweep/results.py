"""What each scene of a sweep brings, a BRDF or the field of one beam or several, and how it is asked for; its
appearance: `samples`."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_vector
from vrte.basics.errors import SceneError
from vrte.calls.brdf import make_brdf
from vrte.calls.radiance import make_field
from vrte.formats.contents import BRDF, DERIVED, FIELDS, PARAMETER, STOKES_AXIS, Kind
from vrte.formats.scene_file import SceneFile
from vrte.formats.toml_table import show_toml
from vrte.request.how import EXACT
from vrte.request.request import Request, make_brdf_request, make_radiance_request
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.results.solution import Solution

OF_BEAMS = ("specular", *DERIVED)  # where a scene may have a smooth surface
OF_MEDIA = ("direct_up", "index")  # of fields, where light is refracted
ALGORITHM = "direct"  # that of vrte.brdf, without what has a tolerance: no engine's numbers differ


@dataclass(frozen=True, eq=False)
class Results:
    """``coordinates`` (n,) that all scenes share, ``variables`` of each scene with dimensions and shape, ``labels``:
    dimensions of Stokes parameters, ``constants`` of the whole table with dimensions and values."""

    kind: Kind
    coordinates: dict[str, Array]
    variables: dict[str, tuple[tuple[str, ...], tuple[int, ...]]]
    labels: tuple[str, ...]
    constants: dict[str, tuple[tuple[str, ...], Array]]

    @property
    def bytes_of_a_scene(self) -> int:
        return sum(8 * math.prod(shape) for _, shape in self.variables.values())


def make_scene_request(file: SceneFile, backend: str | None = None) -> Request:
    """What is asked of a scene, of a backend that its precision goes with unless told otherwise. Raises SceneError."""
    usual = "openmp" if file.options.get("precision", "auto") == "auto" else "opencl"
    how = {"algorithm": ALGORITHM, "backend": backend or usual} | file.options
    if how.get("method", EXACT) != EXACT:
        raise SceneError(f"method = {show_toml(how['method'])}: a sweep is made by {EXACT!r} alone", "method")
    with file.located():
        if file.kind == "brdf":
            return make_brdf_request(file.scene, **file.request, **how, time_limit_s=math.inf)
        if "mu" not in file.request:
            raise SceneError.of(
                "mu", "is missing: all scenes of a table share their directions; mu = [] asks for fluxes alone"
            )
        return make_radiance_request(file.scene, **file.request, **how, time_limit_s=math.inf)


def make_result(request: Request, directions: Array, solution: Solution) -> Brdf | Field:
    """The result that the solution of a request is."""
    if request.kind == "brdf":
        return make_brdf(request, solution)
    found = make_field(request, directions, solution)
    if found.index is not None:
        return found
    # one medium: other scenes of the table may have several
    return replace(
        found, index=np.full(found.tau.size, request.scene.index_above), direct_up=np.zeros_like(found.direct)
    )


def get_values(found: Brdf | Field | Mapping[str, Any], name: str) -> Array | float:
    """An array of a result, or 0 for light of surfaces that it has not and others of its table may have."""
    values: Array | None = found[name] if isinstance(found, Mapping) else getattr(found, name)
    return 0.0 if values is None else values


def describe_results(file: SceneFile, roughnesses: set[float], has_rough_interfaces: bool = False) -> Results:
    """What the scenes of a sweep bring, by the first of them, whose particles nobody needs to know yet, and by the
    roughnesses of the surfaces of all."""
    if file.kind == "brdf":
        request = make_scene_request(file)
        assert request.mu is not None
        coordinates = {"mu_i": request.mu0, "mu_o": request.mu[request.mu > 0.0], "phi_deg": request.phi}
        left_out: tuple[str, ...] = ()
        if request.tau.size == 1 or 0.0 not in roughnesses:
            left_out += ("specular_transmission",)
        left_out += () if request.tau.size > 1 else ("transmission",)  # the bottom, too
        left_out += () if 0.0 in roughnesses else OF_BEAMS
        left_out += () if has_rough_interfaces else ("surface",)
        return lay_out_results(BRDF, coordinates, left_out, ("stokes_out", "stokes_in"), {})
    # how deep the scene is, its particles say: each scene will check its own
    alone = {name: value for name, value in file.request.items() if name != "side"}
    request = make_scene_request(replace(file, request=alone | {"tau": 0.0}))
    incident = np.asarray(file.request.get("stokes", (1.0, 0.0, 0.0, 0.0)), np.float64)
    coordinates = {"mu0": request.mu0, "tau": check_vector("tau", file.request.get("tau", 0.0))}
    left_out = ("incident_stokes", *(("stokes",) if request.fluxes_only else ()), *(() if roughnesses else OF_MEDIA))
    if not request.fluxes_only:
        assert request.mu is not None
        up = -1.0 if request.illuminate == "bottom" else 1.0  # such a request is that of the scene upside down
        coordinates |= {"mu": up * request.mu, "phi_deg": request.phi}
    constants: dict[str, tuple[tuple[str, ...], Array]] = {"incident_stokes": ((STOKES_AXIS,), incident)}
    return lay_out_results(FIELDS, coordinates, left_out, (STOKES_AXIS,), constants)


def lay_out_results(
    kind: Kind,
    coordinates: dict[str, Array],
    left_out: tuple[str, ...],
    labels: tuple[str, ...],
    constants: dict[str, tuple[tuple[str, ...], Array]],
) -> Results:
    """With the shapes of the variables."""
    lengths = {name: values.size for name, values in coordinates.items()} | dict.fromkeys(labels, 4)
    variables = {}
    for name, about in kind.variables.items():
        if name not in left_out and PARAMETER not in about.dims:  # of derivatives there are none
            variables[name] = about.dims, tuple(lengths[dim] for dim in about.dims)
    return Results(kind, coordinates, variables, labels, constants)


RESERVED = {  # names that no axis can have; those of light of surfaces neither where a table has them
    *("error", "checksum", "chunk", "stokes_out", "stokes_in", STOKES_AXIS),
    *(name for kind in (BRDF, FIELDS) for name in (*kind.coordinates, *kind.variables)),
} - {*OF_BEAMS, *OF_MEDIA, "specular_transmission", "surface"}
