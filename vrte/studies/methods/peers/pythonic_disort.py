"""PythonicDISORT, DISORT in NumPy: scalar, delta-M and Nakajima and Tanaka's correction; off its nodes its own
barycentric interpolation, with the correction at the very directions ("eval")."""

import numpy as np

from vrte.results.field import Field
from vrte.studies.methods.peers.asked import Asked, unpolarized

STREAMS = (4, 8, 16, 32, 64)


def check(asked: Asked) -> None:
    """Raises SceneError for what it does not take."""
    asked.check("PythonicDISORT", polarization=False, conservative=False)


def field_of(asked: Asked, streams: int) -> Field:
    """Solved with as many Fourier orders as streams, or as there are terms."""
    from PythonicDISORT import pydisort
    from PythonicDISORT.subroutines import interpolate

    moments = asked.legendre(max(asked.terms, streams + 1))
    is_cut = asked.terms > streams
    _, flux_up, flux_down, _, intensity = pydisort(
        asked.depth,
        asked.albedos,
        streams,
        moments,
        asked.mu0,
        asked.flux,
        0.0,
        NLeg=streams,
        NFourier=min(streams, asked.terms),
        f_arr=moments[:, streams] if is_cut else 0,
        BDRF_Fourier_modes=[asked.base_albedo] if asked.base_albedo else [],
    )
    along = interpolate(intensity, NT_cor="eval" if is_cut else None)
    shape = asked.mu.size, asked.tau.size, asked.phi.size  # squeezed there
    found = np.asarray(along(asked.mu, asked.tau, np.radians(asked.phi))).reshape(shape).swapaxes(0, 1)
    return asked.answer(unpolarized(found), flux_up(asked.tau), flux_down(asked.tau)[0])
