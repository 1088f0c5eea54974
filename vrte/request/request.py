"""A user's request, checked before any work, and the arrays of the result that parts of the solution become."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import (
    Array,
    BoolArray,
    IntArray,
    check_cosines,
    check_flag,
    check_numbers,
    check_vector,
    freeze_copy,
    make_readonly,
    record,
)
from vrte.basics.errors import SceneError
from vrte.request.how import BY_RULE, EXACT, How, check_choice, check_options
from vrte.scene.backscattering import check_interference
from vrte.scene.beams import locate_depths
from vrte.scene.illumination import check_physical, mirror_stokes, turn_to_light
from vrte.scene.scene import Scene


@record
class Wanted:
    """What becomes of a solution: ``parts``, indices of depths (n_level,) and directions (n_mu,) of each array of the
    result; ``place`` (n_col,) of a column in its last axis, shared ones add up; ``scale`` (n_in,)."""

    parts: Sequence[tuple[IntArray, IntArray]]
    place: IntArray
    scale: Array

    def doubles(self, n_phi: int) -> float:
        """How many doubles the result takes."""
        pairs = sum(float(levels.size) * directions.size for levels, directions in self.parts)
        return 4.0 * (int(self.place.max()) + 1) * self.scale.size * n_phi * pairs


SIDES = ("above", "below")  # of an interface
UNIT_COLUMNS = make_readonly(np.eye(4))  # light in each of the Stokes parameters
ROWS = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]])  # (I, Q) and (U, V)


@dataclass(frozen=True, eq=False, kw_only=True)
class Request(How):
    """What is asked of a scene, and how: mu0 (n_in,), incident Stokes columns (n_col, 4), each within (I, Q) or (U, V),
    signed mu (n_mu,), phi (n_phi,) in degrees, tau (n_tau,). ``wanted`` (None: everything) says what becomes of the
    solution. ``fluxes_only``: mu is there for form's sake; ``under`` (n_tau,): whether a depth at an interface lies on
    its lower side. Lit from the bottom, it is asked of a scene upside down, all in a horizontal mirror; ``asked_tau``
    and ``incident``, the Stokes vector (4,) of a beam, are as the user gave them. ``method_rule`` and ``nodes_rule``:
    why the method and the nodes are these; the former is empty where the method was asked for. ``refined``: the
    nodes are one of the counts whose results are compared, and the discrete problem is solved to a share of the
    accuracy. ``coherent``: whether a BRDF is asked for what interference adds to it."""

    kind: str
    scene: Scene
    mu0: Array
    columns: Array
    mu: Array | None
    phi: Array
    tau: Array
    wanted: Wanted | None
    asked_tau: Array | None = None
    incident: Array | None = None
    fluxes_only: bool = False
    under: BoolArray | None = None
    method_rule: str = ""
    nodes_rule: str = "as asked for"
    refined: bool = False
    coherent: bool = False

    @classmethod
    def of(cls, how: How, **asked: Any) -> "Request":
        """What is asked, with options that are checked already."""
        found = object.__new__(cls)
        found.__dict__.update(how.__dict__)
        found.__dict__.update(asked)
        return found


def estimate_operations(request: Request) -> float:
    """Predicted of a request, roughly, whichever way it is solved; infinite where nodes or directions are not known, or
    what flakes and facets scatter takes longer than the rest."""
    scene, mu = request.scene, request.mu
    if scene.below.is_uneven or scene.is_rough or scene.has_flakes or request.nodes is None or mu is None:
        return math.inf
    scalar = all(layer.phase_matrix.is_scalar for layer in scene.layers)
    terms = max(layer.phase_matrix.terms for layer in scene.layers)
    unknowns = float(request.nodes if scalar else 4 * request.nodes)
    orders = min(terms, 2 * request.nodes)
    beams, directions = request.mu0.size * request.columns.shape[0], mu.size * request.tau.size
    per_n3 = cost.SOLVING if request.algorithm in (*BY_RULE, "modes") and not request.verify else cost.DOUBLING
    solving = per_n3 * unknowns**3 + 4.0 * unknowns**2 * (beams + mu.size) + 100.0 * unknowns * directions * (1 + beams)
    summing = (10.0 * terms + 20.0 * orders) * directions * beams * (32 + request.phi.size)
    spreading = cost.A_SPREADING * terms * directions * beams * len(scene.layers) if terms > 2 * request.nodes else 0.0
    return len(scene.layers) * (orders * solving + summing + spreading)


def check_scene(scene: Any) -> Scene:
    """The scene, or a SceneError that says what was given."""
    if not isinstance(scene, Scene):
        raise SceneError.of("scene", f"must be a vrte.Scene, not {type(scene).__name__}")
    return scene


def check_stokes_vector(values: Any) -> Array:
    """Four numbers of any sensible unit that are light. Raises SceneError."""
    array = check_vector("stokes", values)
    if array.shape != (4,):
        raise SceneError.of("stokes", f"must be four numbers I, Q, U, V, not {array.size}")
    check_physical("stokes", array)
    return array


def check_depths(values: Any, scene: Scene) -> Array:
    """Optical depths from 0 to the scene's total; what is beyond by rounding alone counts as the face."""
    if type(values) is float and values == 0.0:  # the top
        return freeze_copy([values])
    given = values if type(values) is float else check_numbers("tau", values)
    if np.isinf(given).any():
        raise SceneError.of("tau", "must be finite, also inside a semi-infinite layer")
    array = check_vector("tau", given)
    total = scene.thickness
    within = np.clip(array, 0.0, total)
    rounding = len(scene.layers) * np.finfo(float).eps * total if math.isfinite(total) else 0.0  # of any sum of layers
    bad = np.abs(array - within) > rounding
    if bad.any():
        words = f"must lie between 0 and the total optical thickness {total:g}, not at {array[bad][0]}"
        raise SceneError.of("tau", words)
    return make_readonly(np.where(total - within <= rounding, total, within)) if rounding else array


def find_under(request: "Request") -> BoolArray:
    """Whether depths at interfaces lie on their lower side, (n_tau,)."""
    return np.zeros(request.tau.size, bool) if request.under is None else request.under


def check_side(side: Any, scene: Scene, tau: Array, illuminate: str) -> BoolArray:
    """Whether depths at interfaces lie on their lower side, as the light meets them, (n_tau,). Raises SceneError for
    another side than the two, and for one asked for where no depth lies at an interface."""
    check_choice("side", side, SIDES)
    turned = illuminate == "bottom"
    under = np.full(tau.size, (side == "below") != turned)
    if side == "below":
        levels = scene.thickness - tau if turned else tau
        upper, lower = (
            locate_depths(scene, levels, np.full(tau.size, way)).interface.tolist() for way in (False, True)
        )
        interfaces = {k for top, bottom in zip(upper, lower, strict=True) if top >= 0 for k in range(top, bottom + 1)}
        if not any(scene.interfaces[k] is not None for k in interfaces):
            raise SceneError.of("side", "'below' is for depths tau at an interface, and none of these is at one")
    return under


def make_brdf_request(
    scene: Any,
    mu_i: Any,
    mu_o: Any,
    phi: Any = 0.0,
    nodes: Any = None,
    threads: Any = None,
    transmission: Any = False,
    progress: Any = None,
    *options: Any,
    coherent: Any = False,
    **more: Any,
) -> Request:
    """What `vrte.brdf` asks with these arguments, which are its own. Raises SceneError, TypeError."""
    how = check_options(*options, nodes=nodes, threads=threads, **more)
    scene = turn_to_light(how.illuminate, scene)
    into, out = check_cosines("mu_i", mu_i), check_cosines("mu_o", mu_o)
    azimuths = check_vector("phi", phi)
    if transmission and not np.isfinite(scene.thickness):
        raise SceneError.of("transmission", "needs a finite thickness: nothing comes out below a semi-infinite layer")
    if check_flag("coherent", coherent):
        if how.method != EXACT:
            raise SceneError.of("coherent", f"is for method {EXACT!r}, not {how.method!r}")
        check_interference(scene, into, out, azimuths)
    levels = np.array([0.0, scene.thickness] if transmission else [0.0])
    directions = np.concatenate([out, -out]) if transmission else out
    # light going up at the top, and light going down at the bottom
    parts = [
        (np.array([k], np.int32), np.arange(k * out.size, (k + 1) * out.size, dtype=np.int32))
        for k in range(levels.size)
    ]
    return Request.of(
        how,
        kind="brdf",
        scene=scene,
        mu0=into,
        columns=UNIT_COLUMNS,
        mu=directions,
        phi=azimuths,
        tau=levels,
        wanted=Wanted(parts, np.arange(4, dtype=np.int32), 1.0 / into),
        under=np.arange(levels.size) > 0,
        coherent=coherent,
    )


def make_radiance_request(
    scene: Any,
    mu0: Any,
    stokes: Any = (1.0, 0.0, 0.0, 0.0),
    mu: Any = None,
    phi: Any = 0.0,
    tau: Any = 0.0,
    nodes: Any = None,
    threads: Any = None,
    progress: Any = None,
    *options: Any,
    side: Any = "above",
    **more: Any,
) -> Request:
    """What `vrte.radiance` asks with these arguments, which are its own. Raises SceneError, TypeError."""
    how = check_options(*options, nodes=nodes, threads=threads, **more)
    scene = turn_to_light(how.illuminate, scene)
    beam = check_cosines("mu0", mu0)
    fluxes_only = isinstance(mu, (list, tuple)) and not mu
    directions = np.ones(1) if fluxes_only else None if mu is None else check_cosines("mu", mu, signed=True)
    incident, azimuths, asked_tau = check_stokes_vector(stokes), check_vector("phi", phi), check_depths(tau, scene)
    arriving, levels = incident, asked_tau
    under = check_side(side, scene, asked_tau, how.illuminate)
    if how.illuminate == "bottom":
        arriving, levels = mirror_stokes(incident), scene.thickness - asked_tau
        directions = None if directions is None else -directions
    parts = [arriving * ROWS[0], arriving * ROWS[1]]
    return Request.of(
        how,
        kind="radiance",
        scene=scene,
        mu0=beam,
        columns=np.array([part for part in parts if part.any()] or parts[:1]),
        mu=directions,
        phi=azimuths,
        tau=levels,
        wanted=None,
        asked_tau=asked_tau,
        incident=incident,
        fluxes_only=fluxes_only,
        under=under,
    )
