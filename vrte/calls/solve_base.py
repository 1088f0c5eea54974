"""vrte.solve_base: a stack solved as the base of others, at as many directions as its accuracy takes."""

import time
import warnings
from typing import Any

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array, check_number, make_readonly
from vrte.basics.errors import AccuracyWarning, SceneError, warn_user
from vrte.basics.splines import make_cosines
from vrte.calls.brdf import brdf, find_brdf
from vrte.calls.plan import make_request, predict_seconds
from vrte.request.how import EXACT, complete_docstring
from vrte.results.brdf import Brdf
from vrte.results.result import find_finest_nodes
from vrte.scene.scene import Scene
from vrte.scene.tabulated_base import CoarseTableWarning, TabulatedBase

COSINES = (12, 24, 48, 96)  # one after another, until the table is good enough
FEWEST_AZIMUTHS, MOST_AZIMUTHS = 9, 361  # from 0 to 180 degrees
CHECKED, CHECKED_FROM = 6, 0.1  # cosines to check a table with, and the smallest of them
CHECKED_AZIMUTHS = make_readonly(np.array([2.3, 17.1, 71.9, 133.7, 174.9]))
FINEST = 1e-8  # accuracy of a table


@complete_docstring
def solve_base(scene: Scene, accuracy: float = 1e-6, **asked: Any) -> TabulatedBase:
    """A stack, solved once, as the base of many others.

    Parameters
    ----------
    {scene}
    accuracy : float, optional
        How far the table may be off between its directions, 1e-8 to 0.1, of the largest f_00: as measured at others,
        with cosines above 0.1. The light over such a base is off by less.
    **asked
        Keywords of `vrte.brdf` but for the directions; ``time_limit_s`` is for all that it takes.

    Returns
    -------
    TabulatedBase
        At 12, 24, 48 or 96 cosines each, the fewest that do, and as many azimuths as it takes, up to 361.

    Raises
    ------
    {SceneError, AccuracyError}

    Warns
    -----
    AccuracyWarning
        Where 96 cosines and 361 azimuths are not enough.

    Examples
    --------
    >>> import vrte
    >>> haze = vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=0.5)
    >>> ground = vrte.solve_base(vrte.Scene([haze], vrte.Lambertian(0.3)), accuracy=1e-4, nodes=8)
    >>> vrte.brdf(vrte.Scene([haze], ground), 0.5, 0.5, nodes=8).mueller.shape
    (1, 1, 1, 4, 4)
    """
    wanted = check_number("accuracy", accuracy, FINEST, 0.1, f"between {FINEST:g} and 0.1")
    for name in {"mu_i", "mu_o", "phi", "transmission", "illuminate", "derivatives", "coherent"} & asked.keys():
        raise SceneError.of(name, "is not asked for here: a base has directions of its own, and is lit from the top")
    begin = time.perf_counter()
    checked = np.random.default_rng(0).uniform(CHECKED_FROM, 1.0, CHECKED)
    first = brdf(scene, checked, checked, **asked)
    if asked.get("method", EXACT) == EXACT:
        asked |= find_finest_nodes([first])  # left to itself, a solve for grazing cosines would take many more
    azimuths = int(np.clip(first.diagnostics.get("orders_of_phase_matrix", 0) + 1, FEWEST_AZIMUTHS, MOST_AZIMUTHS))
    index, more = 0, True
    while more:
        cosines = COSINES[index]
        mu = np.concatenate([make_cosines(cosines), checked])
        phi = np.concatenate([np.linspace(0.0, 180.0, azimuths), CHECKED_AZIMUTHS])
        request = make_request("brdf", scene, mu, mu, phi, **asked)
        seconds = time.perf_counter() - begin + sum(predict_seconds(request))
        why = f" for a base of {cosines} cosines and {azimuths} azimuths"
        cost.warn_runtime(seconds, request.time_limit_s, why, "fewer nodes or a coarser accuracy take less")
        found = find_brdf(request, progress=asked.get("progress"), runtime_warned=True)
        base, off, off_azimuths = split_checked(found, cosines, azimuths)
        if max(off, off_azimuths) <= wanted:
            return base
        finer = min(index + (off > wanted), len(COSINES) - 1), min(2 * azimuths - 1, MOST_AZIMUTHS)
        more = finer[0] > index or (off_azimuths > wanted and finer[1] > azimuths)
        if more:
            index, azimuths = finer[0], finer[1] if off_azimuths > wanted else azimuths
    words = f"the base is off by {max(off, off_azimuths):.2g} between its {cosines} cosines and {azimuths} azimuths"
    warn_user(f"{words}, and {wanted:g} was asked for", AccuracyWarning)
    return base


def split_checked(found: Brdf, cosines: int, azimuths: int) -> tuple[TabulatedBase, float, float]:
    """The table of the first cosines and azimuths, and how far it is off at the others, of the largest f_00."""
    mu, phi, own = found.mu_i[:cosines], found.phi[:azimuths], found.mueller[:cosines, :cosines]
    specular = None if found.specular is None else found.specular[:cosines]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CoarseTableWarning)  # how good it is, is measured here
        base = TabulatedBase(mu, mu, phi, own[:, :, :azimuths], specular, found.diagnostics["index_outside"])

    def find_gap(table: Array, solved: Array) -> float:
        return float(np.abs(table - solved).max() / max(solved[..., 0, 0].max(), 1e-300))

    others, steep = found.mu_i[cosines:], mu > CHECKED_FROM
    between = base.reflect(others[:, None, None], others[:, None], phi)
    off = find_gap(between, found.mueller[cosines:, cosines:, :azimuths])
    if found.specular is not None:
        off = max(off, find_gap(base.reflect_beam(1.0, others), found.specular[cosines:]))
    between = base.reflect(mu[steep][:, None, None], mu[steep][:, None], found.phi[azimuths:])
    return base, off, find_gap(between, own[:, :, azimuths:][steep][:, steep])
