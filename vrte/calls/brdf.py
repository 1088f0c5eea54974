"""vrte.brdf: the Mueller BRDF of a scene, and its transmission."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np

from vrte.basics.arrays import Array, freeze, make_readonly, replace_unchecked
from vrte.basics.running import Progress, start_run
from vrte.calls.derivatives import Derivative, Derivatives, collect_jacobians, find_light, read_derivatives
from vrte.calls.energy import defer, note_energy
from vrte.calls.photon_check import note_photons, share_with_photons
from vrte.discrete_ordinates.execution.through_interfaces import find_rough_reflection
from vrte.methods import choose_method
from vrte.methods.discrete_ordinates import warn_of_negative
from vrte.request.how import complete_docstring
from vrte.request.request import Request, make_brdf_request
from vrte.results.brdf import BRDF_DERIVATIVES, Brdf
from vrte.results.result import Solution
from vrte.scene.backscattering import find_back_directions, find_interference
from vrte.scene.beams import find_direct_light, locate_depths
from vrte.scene.illumination import mirror_mueller
from vrte.scene.scene import Scene
from vrte.scene.vary import Variation


@complete_docstring
def brdf(
    scene: Scene,
    mu_i: Any,
    mu_o: Any,
    phi: Any = 0.0,
    nodes: int | None = None,
    threads: int | None = None,
    transmission: bool = False,
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
    derivatives: Derivatives = None,
    coherent: bool = False,
) -> Brdf:
    """The Mueller BRDF (1:1) for all pairs of directions, four incident Stokes vectors at once, (1:39).

    Lit from the bottom, the BRDF is that of the bottom and the BTDF leads out of the top; cosines are positive as ever.

    Parameters
    ----------
    {all}

    Returns
    -------
    Brdf
        ``mueller`` (n_in, n_out, n_phi, 4, 4) [1/sr], ``reflectance`` (n_in,), and what else goes with it.

    Raises
    ------
    {SceneError, AccuracyError, DeviceError}

    Examples
    --------
    >>> import numpy as np
    >>> import vrte
    >>> white = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.5, thickness=0.0)], vrte.Lambertian(1.0))
    >>> round(float(vrte.brdf(white, mu_i=0.5, mu_o=0.5, nodes=4).mueller[0, 0, 0, 0, 0] * np.pi), 12)
    1.0
    """
    asked = locals()
    variations = read_derivatives(scene, asked.pop("derivatives"))
    request = choose_method(make_brdf_request(**asked))
    return find_brdf(request, variations, progress)


def find_brdf(
    request: Request,
    variations: Sequence[Variation] = (),
    progress: Progress | None = None,
    runtime_warned: bool = False,
) -> Brdf:
    """The result of a request, solved, and verified by photons where it asks for that."""
    solving, verifying = share_with_photons(request, progress)
    _, solution, derivatives = find_light(request, variations, solving, runtime_warned)
    return make_brdf(request, solution, derivatives, verifying)


def make_brdf(
    request: Request, solution: Solution, derivatives: Sequence[Derivative] = (), progress: Progress | None = None
) -> Brdf:
    """The result of a solution and its derivatives; ``progress`` of the photons that verify it."""
    scene, directions, is_turned = request.scene, request.mu, request.illuminate == "bottom"
    assert directions is not None
    mu_o = directions[directions > 0.0]
    arrays: dict[str, Any] = gather_arrays(request, solution)
    for name in ("mueller", "transmission"):
        if name in arrays:
            warn_of_negative(request, arrays[name][..., 0, 0], solution.diagnostics)
    beams = find_beams(request)
    arrays |= {name: values for name, values in beams.items() if name == "direct_transmittance" or values.any()}
    jacobians = collect_jacobians(BRDF_DERIVATIVES, arrays.keys(), request, derivatives, gather_arrays, find_beams)
    if scene.is_rough:
        surface = find_rough_reflection(scene, request.mu0, mu_o, request.phi, start_run(1))
        arrays["surface"] = mirror_mueller(surface) if is_turned else surface
    if request.coherent:
        arrays["coherent"] = find_interference(scene, request.mu0, mu_o, request.phi, arrays["mueller"])
    found = {"illuminate": request.illuminate, "index_outside": scene.index_below if is_turned else scene.index_above}
    found |= note_photons(request, progress)
    if not derivatives:  # the arrays fit together
        arrays |= {"mu_i": request.mu0, "mu_o": mu_o, "phi": request.phi}
        frozen = {name: freeze(each) for name, each in arrays.items()}
        late = partial(describe_brdf, request, replace_unchecked(solution, parts=[]), found)
        return Brdf.with_late_diagnostics(defer(request, late), **frozen)
    diagnostics = describe_brdf(request, solution, found)
    return Brdf(mu_i=request.mu0, mu_o=mu_o, phi=request.phi, diagnostics=diagnostics, **arrays, **jacobians)


def describe_brdf(request: Request, solution: Solution, found: dict[str, Any]) -> dict[str, Any]:
    """The diagnostics of a BRDF: those of its solution, and what else is found. Warns of facets that make light."""
    return note_interference(request, note_energy(request, solution) | found)


def note_interference(request: Request, diagnostics: dict[str, Any]) -> dict[str, Any]:
    """The diagnostics of a BRDF, with a note where it has a direction in which interference adds to what it holds."""
    assert request.mu is not None
    same, turned = find_back_directions(request.mu0, request.mu, request.phi)
    scatters = any([layer.albedo > 0.0 and layer.thickness > 0.0 for layer in request.scene.layers])
    if not (scatters and turned.any() and same.any()):
        return diagnostics
    where = "coherent has it" if request.coherent else "coherent=True asks for it"
    note = f"back to the source, mu_o = mu_i and phi = 180, interference adds to mueller: {where}"
    return diagnostics | {"notes": [*diagnostics.get("notes", ()), note]}


def gather_arrays(request: Request, solution: Solution) -> dict[str, Array]:
    """Mueller matrices (n_in, n_mu, n_phi, 4, 4) out of the top and bottom from the lit side, reflectance (n_in,)."""
    matrices = [make_readonly(values)[0] for values in solution.parts]  # of one depth
    if request.illuminate == "bottom":
        matrices = [mirror_mueller(values) for values in matrices]
    reflectance = solution.flux_up[0, :, 0] / request.mu0
    return dict(zip(("mueller", "transmission"), matrices, strict=False)) | {"reflectance": reflectance}


def find_beams(request: Request) -> dict[str, Array]:
    """Shares (n_in,) of beams that get through; their Mueller matrices (n_in, 4, 4), mirrored and turned."""
    scene, into = request.scene, request.mu0
    direct = np.zeros((2, into.size, 2, 4, 4))
    through = np.exp(-scene.thickness / into)
    if scene.needs_beam_paths:
        ends = slice(1 + bool(np.isfinite(scene.thickness)))
        depths = locate_depths(scene, np.array([0.0, scene.thickness])[ends], np.array([False, True])[ends])
        found = find_direct_light(scene, into, depths)
        direct[ends] = mirror_mueller(found) if request.illuminate == "bottom" else found
        through = direct[1, :, 1, 0, 0]
    return {"direct_transmittance": through, "specular": direct[0, :, 0], "specular_transmission": direct[1, :, 1]}
