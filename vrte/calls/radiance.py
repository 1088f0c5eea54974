"""vrte.radiance: the field of one beam, or of several; and vrte.views: single geometries, as instruments in orbit list
them, with the sun, line of sight and azimuth of each."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, check_number, check_vector, freeze, make_readonly, replace_unchecked
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress
from vrte.calls.derivatives import Derivative, Derivatives, collect_jacobians, find_light, read_derivatives
from vrte.calls.energy import defer, note_energy
from vrte.calls.photon_check import note_photons, share_with_photons
from vrte.calls.plan import make_request, warn_runtime_of_all
from vrte.methods import choose_method
from vrte.methods.discrete_ordinates import warn_of_negative
from vrte.request.how import complete_docstring
from vrte.request.request import Request, find_under, make_radiance_request
from vrte.results.field import FIELD_DERIVATIVES, Field, Views
from vrte.results.result import Solution
from vrte.scene.beams import find_direct_light, locate_depths
from vrte.scene.illumination import mirror_stokes
from vrte.scene.scene import Scene


@complete_docstring
def radiance(
    scene: Scene,
    mu0: Any,
    stokes: Any = (1.0, 0.0, 0.0, 0.0),
    mu: Any = None,
    phi: Any = 0.0,
    tau: Any = 0.0,
    nodes: int | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    algorithm: str | None = None,
    verify: bool | Literal["photons"] | None = None,
    accuracy: float | None = None,
    truncation: str | None = None,
    backend: str | None = None,
    method: str = "discrete-ordinates",
    settings: Mapping[str, Any] | None = None,
    illuminate: str = "top",
    time_limit_s: float | None = None,
    precision: str | None = None,
    grading: int | None = None,
    side: str = "above",
    derivatives: Derivatives = None,
) -> Field:
    """The diffuse field of one beam, or of several in one solve, by discrete ordinates or another method.

    Collin, Pattanaik and Bouatouch, section 2.

    Parameters
    ----------
    {scene}
    mu0 : float or sequence of float
        The beam's positive cosine, or those of several, whose axis the result then has in front.
    stokes : sequence of float, optional
        The beam's flux vector I, Q, U, V perpendicular to it, I >= 0 and I^2 >= Q^2 + U^2 + V^2.
    mu : float or sequence of float, optional
        Signed cosines, n_mu, above 0 going up; default: the nodes, up and down; an empty list: fluxes alone.
    {phi}
    tau : float or sequence of float, optional
        Optical depths, n_tau; default: the top.
    {progress, options}
    side : {'above', 'below'}, optional
        Of an interface, for depths that lie at one: tau = 0 is outside by default.
    {derivatives}

    Returns
    -------
    Field
        ``stokes`` (n_tau, n_mu, n_phi, 4) in units of the beam's flux per steradian, ``flux_up``, ``flux_down`` and
        ``direct`` (n_tau,); of several beams with their axis in front.

    Raises
    ------
    {SceneError, AccuracyError, DeviceError}

    Examples
    --------
    >>> import vrte
    >>> scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)])
    >>> vrte.radiance(scene, mu0=0.6, mu=[0.5, -0.5], nodes=8).stokes.shape
    (1, 2, 1, 4)
    """
    asked = locals()
    variations = read_derivatives(scene, asked.pop("derivatives"))
    request = choose_method(make_radiance_request(**asked))
    alone = type(mu0) is float or np.ndim(mu0) == 0  # a number, not even a list of length 1
    solving, verifying = share_with_photons(request, progress)
    return make_field(request, *find_light(request, variations, solving), alone=alone, progress=verifying)


def make_field(
    request: Request,
    directions: Array,
    solution: Solution,
    derivatives: Sequence[Derivative] = (),
    alone: bool = False,
    progress: Progress | None = None,
) -> Field:
    """The field of a solution and its derivatives; ``alone``: without the axis of beams; ``progress`` of photons."""
    warn_of_negative(request, solution.parts[0].swapaxes(0, 1)[..., 0, 0], solution.diagnostics)
    index = None
    if request.scene.needs_beam_paths:
        index = locate_depths(request.scene, request.tau, find_under(request)).medium(request.scene.media)
    if request.illuminate == "bottom" and request.mu is not None:
        directions = -directions
    directions = directions[: 0 if request.fluxes_only else None]
    beam: Any = 0 if alone else slice(None)

    def gather(asked: Request, found: Solution) -> dict[str, Array]:
        stokes, up, down = gather_light(asked, found)
        return {"stokes": stokes[beam][..., : directions.size, :, :], "flux_up": up[beam], "flux_down": down[beam]}

    def find(asked: Request) -> dict[str, Array]:
        direct, direct_up = find_beams(asked)
        return {"direct": direct[beam]} | ({"direct_up": direct_up[beam]} if asked.scene.needs_beam_paths else {})

    arrays: dict[str, Any] = gather(request, solution) | find(request)
    jacobians = collect_jacobians(FIELD_DERIVATIVES, arrays.keys(), request, derivatives, gather, find)
    found = note_photons(request, progress) | {"illuminate": request.illuminate}
    arrays |= {"tau": request.asked_tau, "mu": directions, "phi": request.phi, "incident_stokes": request.incident}
    arrays |= {} if index is None else {"index": index}
    mu0 = float(request.mu0[0]) if alone else request.mu0
    if not derivatives:  # the arrays fit together
        late = partial(describe_field, request, replace_unchecked(solution, parts=[]), found)
        return Field.with_late_diagnostics(
            defer(request, late), mu0=mu0, **{name: freeze(each) for name, each in arrays.items()}
        )
    return Field(mu0=mu0, diagnostics=describe_field(request, solution, found), **arrays, **jacobians)


def describe_field(request: Request, solution: Solution, found: dict[str, Any]) -> dict[str, Any]:
    """The diagnostics of a field: those of its solution, and what else is found."""
    return note_energy(request, solution) | found


def gather_light(request: Request, solution: Solution) -> tuple[Array, Array, Array]:
    """Stokes vectors (n_in, n_tau, n_mu, n_phi, 4) and fluxes up and down (n_in, n_tau), from the lit side."""
    seen = make_readonly(solution.parts[0])[..., 0].swapaxes(0, 1)
    up, down = solution.flux_up.sum(axis=-1).T, solution.flux_down.sum(axis=-1).T
    if request.illuminate == "top":
        return seen, up, down
    seen = mirror_stokes(seen)
    if request.mu is None:  # the nodes, up and down, the other way round
        seen = np.roll(seen, seen.shape[2] // 2, axis=2)
    return seen, down, up


def find_beams(request: Request) -> Array:
    """Fluxes of beams that go on from the lit side, and that come back, (2, n_in, n_tau)."""
    incident, beams = request.incident, request.mu0[:, None]
    assert incident is not None
    if not request.scene.needs_beam_paths:
        down = beams * incident[0] * np.exp(-request.tau / beams)
        return np.stack([down, np.zeros_like(down)])
    depths = locate_depths(request.scene, request.tau, find_under(request))
    passing = np.moveaxis(find_direct_light(request.scene, request.mu0, depths)[..., 0, :], 1, 0)
    light = mirror_stokes(incident) if request.illuminate == "bottom" else incident
    up, down = np.moveaxis(request.mu0[:, None, None] * (passing @ light), 2, 0)
    return np.stack([up, down] if request.illuminate == "bottom" else [down, up])


MOST_GEOMETRIES = 1_000_000
LARGEST_GRID = 1e6  # directions of all distinct mu0, mu and phi that are solved for together: 32 MB


@complete_docstring
def views(
    scene: Scene,
    mu0: Any,
    mu: Any,
    phi: Any = 0.0,
    stokes: Any = (1.0, 0.0, 0.0, 0.0),
    tau: float = 0.0,
    **how: Any,
) -> Views:
    """The diffuse radiance of many beams, each in one direction of its own.

    Parameters
    ----------
    {scene}
    mu0, mu : float or array_like (n,)
        Positive cosines of the beams, and signed cosines of the lines of sight, above 0 going up, a geometry each; a
        number is taken for all.
    phi : float or array_like (n,), optional
        Azimuths from each beam's heading [degrees].
    stokes : array_like (4,), optional
        Flux vector I, Q, U, V of all beams, perpendicular to them; default: unpolarized.
    tau : float, optional
        One optical depth, by default the top.
    **how
        All else as for `vrte.radiance`; ``time_limit_s`` is for all geometries together.

    Returns
    -------
    Views
        A row a geometry; they are solved for together, few or many as their distinct values allow.

    Raises
    ------
    {SceneError, AccuracyError, DeviceError}

    Examples
    --------
    >>> import vrte
    >>> scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)])
    >>> vrte.views(scene, mu0=[0.6, 0.61, 0.62], mu=[0.9, 0.8, 0.7], phi=30.0, nodes=8).stokes.shape
    (3, 4)
    """
    if how.get("derivatives") is not None:
        raise SceneError.of("derivatives", "are not for single geometries: ask vrte.radiance for them")
    given = [check_vector(name, values) for name, values in (("mu0", mu0), ("mu", mu), ("phi", phi))]
    depth = check_number("tau", tau, 0.0, float("inf"), "one optical depth >= 0")
    try:
        geometries = np.array(np.broadcast_arrays(*given))
    except ValueError:
        sizes = ", ".join(str(each.size) for each in given)
        raise SceneError(f"mu0, mu and phi must be of one length, a geometry each, not of {sizes}") from None
    beams, sights, azimuths = geometries
    if beams.size > MOST_GEOMETRIES:
        raise SceneError(f"there must be at most {MOST_GEOMETRIES} geometries, not {beams.size}")
    groups = list(split_geometries(np.lexsort((azimuths, sights, beams)), geometries))

    def asked_at(place: int) -> tuple[Request, float]:
        mu0, mu, phi = map(np.unique, geometries[:, groups[place]])
        return make_request("radiance", scene, mu0, stokes, mu, phi, depth, **how), 0.0

    warn_runtime_of_all(len(groups), asked_at, f"{len(groups)} groups of geometries")
    seen, solves = np.empty((beams.size, 4)), list[dict[str, Any]]()
    for rows in groups:
        (mu0, i), (mu, o), (phi, p) = (np.unique(each[rows], return_inverse=True) for each in geometries)
        found = radiance(scene, mu0, stokes, mu, phi, depth, **how)
        seen[rows] = found.stokes[i, 0, o, p]
        solves.append(found.diagnostics)
    index = None if found.index is None else float(found.index[0])
    return Views(seen, beams, sights, azimuths, depth, found.incident_stokes, {"solves": solves}, index)


def split_geometries(rows: NDArray[np.intp], geometries: Array) -> Iterator[NDArray[np.intp]]:
    """Rows, equal ones next to each other, halved until the grid of their distinct values is small enough."""
    grid = np.prod([float(np.unique(each[rows]).size) for each in geometries])
    if rows.size > 1 and grid > LARGEST_GRID:
        for half in np.array_split(rows, 2):
            yield from split_geometries(half, geometries)
    else:
        yield rows
