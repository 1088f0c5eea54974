"""nanodisort, the C translation of DISORT: scalar, delta-M, and Nakajima and Tanaka's correction for the peak."""

from typing import Any

import numpy as np

from vrte.results.field import Field
from vrte.studies.methods.peers.asked import Asked, unpolarized

STREAMS = (4, 8, 16, 32, 64, 128)


def check(asked: Asked) -> None:
    """Raises SceneError for what it does not take; albedo 1 it lowers by itself, by some roundings."""
    asked.check("nanodisort", polarization=False)


def state_of(asked: Asked, streams: int, accuracy: float) -> Any:
    """All that it is told: directions in ascending order, as it wants them; "old" is the correction that it has for any
    phase function. ``accuracy``: of the sum over azimuthal orders."""
    import nanodisort

    state = nanodisort.DisortState()
    moments = asked.legendre(max(asked.terms, streams + 1))
    state.nstr, state.nlyr, state.nmom = streams, moments.shape[0], moments.shape[1] - 1
    state.ntau, state.numu, state.nphi = asked.tau.size, asked.mu.size, asked.phi.size
    state.usrtau = state.usrang = state.lamber = state.quiet = True
    state.planck = state.onlyfl = state.spher = False
    state.intensity_correction = state.old_intensity_correction = True
    state.fbeam, state.umu0, state.phi0, state.albedo = asked.flux, asked.mu0, 0.0, asked.base_albedo
    state.accur = accuracy
    state.allocate()
    state.dtauc, state.ssalb, state.pmom = np.diff(asked.depth, prepend=0.0), asked.albedos, moments.T
    state.umu, state.phi, state.utau = np.sort(asked.mu), asked.phi, asked.tau
    return state


def field_of(asked: Asked, state: Any) -> Field:
    """Solved, in the order of directions that was asked for."""
    state.solve()
    places = np.argsort(np.argsort(asked.mu))
    found = np.asarray(state.uu)[places].swapaxes(0, 1)  # (mu, tau, phi) there
    return asked.answer(unpolarized(found), np.array(state.flup), np.array(state.rfldn))
