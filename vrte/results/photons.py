"""What photons found: fluxes of Mueller matrices by bins of directions, with standard errors."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.results.result import Labelled


@dataclass(frozen=True, eq=False, repr=False)
class Photons(Labelled):
    """Fluxes that photons carried, as `vrte.photons` counts them, and the standard error of each.

    All fluxes are Mueller matrices, flux out over the incident flux through the same horizontal plane, in the meridian
    planes of both directions. Bins hold diffuse light; beams are apart, as in `vrte.Brdf`. Both azimuths of a bin,
    phi and -phi, are added, the latter as its mirror image. All arrays are read-only.

    Attributes
    ----------
    up
        Light that goes up at each depth, (n_in, n_tau, n_mu, n_phi, 4, 4), bin by bin.
    up_error
        Its standard errors, of the same shape.
    down
        Light that goes down at each depth, likewise.
    down_error
        Its standard errors.
    beam_up
        The fraction of the beam that goes up at each depth without having been scattered, (n_in, n_tau, 4, 4).
    beam_up_error
        Its standard errors.
    beam_down
        The same that goes down.
    beam_down_error
        Its standard errors.
    absorbed
        The fraction of unpolarized light that each layer absorbs, (n_in, n_layer).
    lost
        The fraction that the base absorbs, or that surfaces hide and do not give back, (n_in,).
    balance
        The sum of all that leaves at the top, at the bottom, and stays, (n_in,): 1 up to noise where surfaces conserve
        energy.
    mu_i
        Cosines of incidence, (n_in,).
    tau
        Depths, (n_tau,).
    mu_edges
        Ascending cosines between bins, (n_mu + 1,), of either sign.
    phi_edges
        Ascending azimuths between bins, (n_phi + 1,) [degrees], 0 to 180.
    diagnostics
        How they were found, by name: photons of each beam, seed, collisions of a photon, the fraction given up after a
        million events, run time.

    Raises
    ------
    SceneError
        Where the shapes do not fit together.

    Examples
    --------
    >>> import vrte
    >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)])
    >>> vrte.photons(haze, mu_i=0.6, photons=1000).balance.round(12).tolist()
    [1.0]
    """

    up: Array
    up_error: Array
    down: Array
    down_error: Array
    beam_up: Array
    beam_up_error: Array
    beam_down: Array
    beam_down_error: Array
    absorbed: Array
    lost: Array
    balance: Array
    mu_i: Array
    tau: Array
    mu_edges: Array
    phi_edges: Array
    diagnostics: dict[str, Any]

    def __post_init__(self) -> None:
        beams, depths = np.size(self.mu_i), (np.size(self.mu_i), np.size(self.tau))
        bins = (*depths, np.size(self.mu_edges) - 1, np.size(self.phi_edges) - 1, 4, 4)
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("up", "up_error", "down", "down_error"), bins)
        shapes |= {f"beam_{way}{what}": (*depths, 4, 4) for way in ("up", "down") for what in ("", "_error")}
        shapes |= {"absorbed": (beams, *np.shape(self.absorbed)[-1:]), "lost": (beams,), "balance": (beams,)}
        shapes |= {name: (np.size(getattr(self, name)),) for name in ("mu_i", "tau", "mu_edges", "phi_edges")}
        self._freeze(shapes)

    def __repr__(self) -> str:
        bins = f"{self.mu_edges.size - 1} x {self.phi_edges.size - 1} bins"
        return f"Photons({self.mu_i.size} mu_i, {self.tau.size} tau, {bins}, {self.diagnostics.get('photons', 0)} each)"
