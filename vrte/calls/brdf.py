"""vrte.brdf: the Mueller BRDF of a scene, and its transmission."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, freeze_copy, settle_array
from vrte.basics.running import Progress, run_interruptible, start_run
from vrte.calls.derivatives import (
    Derivative,
    Derivatives,
    check_differentiable,
    read_derivatives,
    solve_with_derivatives,
)
from vrte.calls.differences import differentiate_beams
from vrte.calls.energy import note_energy
from vrte.discrete_ordinates.execution.through_interfaces import find_rough_reflection
from vrte.methods import choose_method, make_run
from vrte.methods.discrete_ordinates import warn_of_negative
from vrte.request.how import complete_docstring
from vrte.request.request import Request, make_brdf_request
from vrte.results.brdf import Brdf
from vrte.results.solution import Solution
from vrte.scene.beams import find_direct_light, locate_depths
from vrte.scene.illumination import mirror_mueller
from vrte.scene.scene import Scene
from vrte.scene.variation import Variation


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
    verify: bool | None = None,
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
    return solve_brdf(choose_method(make_brdf_request(**asked)), progress, variations=variations)


def solve_brdf(
    request: Request, progress: Progress | None = None, told: bool = False, variations: Sequence[Variation] = ()
) -> Brdf:
    """Of a request with its method named; ``told``: what it takes was said; ``variations`` to differentiate with."""
    if variations:
        check_differentiable(request)
    run = make_run(request)
    run.runtime_warned = told
    found = run_interruptible(run, lambda: solve_with_derivatives(request, variations, run, progress))
    return make_brdf(request, *found[1:])


def make_brdf(request: Request, solution: Solution, derivatives: Sequence[Derivative] = ()) -> Brdf:
    """What was found, as a result."""
    into, directions = request.mu0, request.mu
    assert directions is not None
    matrices = gather_matrices(request, solution)
    changes = {one.name: gather_matrices(request, one.solution) for one in derivatives}
    fluxes = {one.name: freeze_copy(one.solution.flux_up[0, :, 0] / into) for one in derivatives}
    specular, through, share = find_beams(request)
    by_beams: dict[str, dict[str, Array]] = {"direct_transmittance_jacobian": {}, "specular_jacobian": {}}
    for one in derivatives:
        changed = differentiate_beams(request, one.variation, join_beams)
        by_beams["direct_transmittance_jacobian"][one.name] = freeze_copy(changed[:, 0])
        if specular.any():
            by_beams["specular_jacobian"][one.name] = freeze_copy(changed[:, 1:].reshape(-1, 4, 4))
    surface = None
    if request.scene.is_rough:
        surface = find_rough_reflection(request.scene, into, directions[directions > 0.0], request.phi, start_run(1))
        surface = mirror_mueller(surface) if request.illuminate == "bottom" else surface
    outside = request.scene.index_below if request.illuminate == "bottom" else request.scene.index_above
    for values in matrices:
        warn_of_negative(request, values[..., 0, 0], solution.diagnostics)
    return Brdf(
        mueller=matrices[0],
        reflectance=freeze_copy(solution.flux_up[0, :, 0] / into),
        transmission=matrices[1] if len(matrices) > 1 else None,
        direct_transmittance=freeze_copy(share),
        mu_i=into,
        mu_o=directions[directions > 0.0],
        phi=request.phi,
        diagnostics=note_energy(request, solution) | {"illuminate": request.illuminate, "index_outside": outside},
        specular=freeze_copy(specular) if specular.any() else None,
        surface=None if surface is None else freeze_copy(surface),
        specular_transmission=freeze_copy(through) if through.any() else None,
        jacobian={name: found[0] for name, found in changes.items()},
        reflectance_jacobian=fluxes,
        transmission_jacobian={name: found[1] for name, found in changes.items()} if len(matrices) > 1 else None,
        **by_beams,
    )


def find_beams(request: Request) -> tuple[Array, Array, Array]:
    """Mueller matrices (n_in, 4, 4) of the beams that are mirrored, of those that get through where light is turned on
    its way, 0 elsewhere, and the share (n_in,) of light that gets through as a beam."""
    scene, into = request.scene, request.mu0
    nothing = np.zeros((into.size, 4, 4))
    if not scene.keeps_beams:
        return nothing, nothing, np.exp(-scene.thickness / into)
    faces, lower = np.array([0.0, scene.thickness]), np.array([False, True])
    ends = slice(1 + bool(np.isfinite(faces[1])))
    direct = find_direct_light(scene, into, locate_depths(scene, faces[ends], lower[ends]))
    if request.illuminate == "bottom":
        direct = mirror_mueller(direct)
    through = direct[1, :, 1] if direct.shape[0] > 1 else nothing
    return direct[0, :, 0], through, through[:, 0, 0]


def join_beams(request: Request) -> Array:
    """The share of each beam that gets through, and the elements of what is mirrored of it, (n_in, 17)."""
    specular, _, share = find_beams(request)
    return np.concatenate([share[:, None], specular.reshape(-1, 16)], axis=1)


def gather_matrices(request: Request, solution: Solution) -> list[Array]:
    """Mueller matrices (n_in, n_mu, n_phi, 4, 4) of light going up at the top and, where asked for, down at the
    bottom, as seen from the side that is lit."""
    matrices = [settle_array(values)[0] for values in solution.parts]  # of one depth
    return [mirror_mueller(values) for values in matrices] if request.illuminate == "bottom" else matrices
