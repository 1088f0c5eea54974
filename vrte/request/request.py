"""What a user asks for, checked before any work."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, flag, number, numbers, settled, shown, vector, whole
from vrte.basics.errors import SceneError
from vrte.optics.truncation import CHOICES
from vrte.request.backends import BACKENDS, Backend, backend_of
from vrte.request.wanted import Wanted
from vrte.scene.illumination import SIDES, check_physical, lit_from, mirrored_stokes
from vrte.scene.scene import Scene

EXACT = "discrete-ordinates"
AUTO = "auto"  # one of the methods, by the rules of vrte/methods/auto/rules.py
_FILES = iter_modules([str(Path(__file__).parents[1] / "methods")])  # each is a method; what they share is in folders
_NAMES = {file.name.replace("_", "-") for file in _FILES if not file.ispkg}
METHODS = (EXACT, *sorted(_NAMES - {EXACT}))
ALGORITHMS = ("auto", "direct", "modes", "doubling", "invariance")
BY_RULE = ("auto", "direct")  # direct: auto's rule without what iterates to a tolerance
METHOD_NAMES = (*METHODS, AUTO)  # that can be asked for
SMALLEST_COSINE = 1e-8
MOST_NODES = 4096
FINEST, COARSEST = 1e-15, 0.1  # accuracy that can be asked for
WITH_NODES, WITHOUT_NODES = 1e-8, 1e-6  # what it is by default
TIME_LIMIT_S = 3600.0  # by default
SOLVING, DOUBLING = 60.0, 1000.0  # operations of an order and layer over n^3, by modes and by doubling


@dataclass(frozen=True, eq=False)
class Request:
    """What is asked of a scene: mu0 (n_in,), incident Stokes columns (n_col, 4), each within (I, Q) or (U, V), signed
    mu (n_mu,), phi (n_phi,) in degrees, tau (n_tau,), and how: nodes (None: chosen by the plan), accuracy relative to
    the largest I at each depth, algorithm, verify, truncation, backend, method and its settings. ``wanted`` (None:
    everything) says what becomes of the solution. ``fluxes_only``: mu is there for form's sake. ``illuminate``: where
    the light comes from; "bottom" is asked of a scene upside down, all in a horizontal mirror. ``method_rule`` and
    ``nodes_rule``: why the method and the nodes are these; the former is empty where the method was asked for.
    ``given``: names of the options that the user gave, which a method uses or refuses. ``time_limit_s``: what is
    predicted to take longer is refused."""

    kind: str
    scene: Scene
    mu0: Array
    columns: Array
    mu: Array | None
    phi: Array
    tau: Array
    wanted: Wanted | None
    nodes: int | None
    accuracy: float
    algorithm: str
    verify: bool
    truncation: str
    fluxes_only: bool = False
    backend: Backend = Backend.OPENMP
    method: str = EXACT
    settings: Mapping[str, Any] = field(default_factory=dict)
    illuminate: str = "top"
    method_rule: str = ""
    nodes_rule: str = "as asked for"
    given: frozenset[str] = frozenset()
    time_limit_s: float = TIME_LIMIT_S


def operations_of(request: Request) -> float:
    """Predicted of a request, roughly, whichever way it is solved; infinite where that takes a plan to say."""
    scene, mu = request.scene, request.mu
    if scene.below.mixes_stokes or request.nodes is None or mu is None:
        return math.inf
    scalar = all(layer.phase_matrix.is_scalar for layer in scene.layers)
    terms = max(layer.phase_matrix.terms for layer in scene.layers)
    if terms > 2 * request.nodes and request.truncation != "none":
        return math.inf
    unknowns = float(request.nodes if scalar else 4 * request.nodes)
    orders = min(terms, 2 * request.nodes)
    beams, directions = request.mu0.size * request.columns.shape[0], mu.size * request.tau.size
    per_n3 = SOLVING if request.algorithm in (*BY_RULE, "modes") and not request.verify else DOUBLING
    solving = per_n3 * unknowns**3 + 4.0 * unknowns**2 * (beams + mu.size) + 100.0 * unknowns * directions * (1 + beams)
    summing = (10.0 * terms + 20.0 * orders) * directions * beams * (32 + request.phi.size)
    return len(scene.layers) * (orders * solving + summing)


def check_scene(scene: Any) -> Scene:
    """The scene, or a SceneError that says what was given."""
    if not isinstance(scene, Scene):
        raise SceneError.of("scene", f"must be a vrte.Scene, not {type(scene).__name__}")
    return scene


def cosines(name: str, values: Any, signed: bool = False) -> Array:
    """Cosines with 1e-8 <= |mu| <= 1, positive unless `signed`."""
    array = vector(name, values)
    size = np.abs(array) if signed else array
    bad = ~((size >= SMALLEST_COSINE) & (size <= 1.0))
    if bad.any():
        allowed = "1e-8 <= |mu| <= 1 (above 0: up, below 0: down)" if signed else "1e-8 <= mu <= 1"
        raise SceneError.of(name, f"must satisfy {allowed}, not {array[bad][0]}")
    return array


def stokes_vector(values: Any) -> Array:
    """Four numbers of any sensible unit that are light. Raises SceneError."""
    array = vector("stokes", values)
    if array.shape != (4,):
        raise SceneError.of("stokes", f"must be four numbers I, Q, U, V, not {array.size}")
    check_physical("stokes", array)
    return array


def depths(values: Any, scene: Scene) -> Array:
    """Optical depths from 0 to the scene's total; what is beyond by rounding alone counts as the face."""
    given = values if type(values) is float else numbers("tau", values)
    if np.isinf(given).any():
        raise SceneError.of("tau", "must be finite, also inside a layer without end")
    array = vector("tau", given)
    total = scene.thickness
    within = np.clip(array, 0.0, total)
    rounding = len(scene.layers) * np.finfo(float).eps * total if math.isfinite(total) else 0.0  # of any sum of layers
    bad = np.abs(array - within) > rounding
    if bad.any():
        raise SceneError.of(
            "tau", f"must lie between 0 and the total optical thickness {total:g}, not at {array[bad][0]}"
        )
    return settled(np.where(total - within <= rounding, total, within)) if rounding else array


def one_of(name: str, value: Any, allowed: tuple[str, ...]) -> str:
    """One of the names allowed."""
    if not (isinstance(value, str) and value in allowed):
        raise SceneError.of(name, f"must be {', '.join(map(repr, allowed))}, not {shown(value)}")
    return value


def solver_options(
    nodes: Any = None,
    accuracy: Any = None,
    algorithm: Any = None,
    verify: Any = None,
    truncation: Any = None,
    backend: Any = None,
    method: Any = EXACT,
    settings: Any = None,
    illuminate: Any = "top",
    time_limit_s: Any = None,
) -> dict[str, Any]:
    """As fields of a Request: nodes of a hemisphere or None, accuracy, the algorithm's name, a yes or no, the names of
    the truncation, the backend and the method, the method's settings, the side that is lit, and which of the first six
    were given. None stands for what the user left out."""
    asked = {"nodes": nodes, "accuracy": accuracy, "algorithm": algorithm, "truncation": truncation, "backend": backend}
    given = frozenset(
        name for name, value in (asked | {"verify": None if verify is False else verify}).items() if value is not None
    )
    defaults = {"algorithm": "auto", "verify": False, "truncation": "auto", "backend": "openmp"}
    algorithm, verify, truncation, backend = (
        default if value is None else value
        for default, value in zip(defaults.values(), (algorithm, verify, truncation, backend), strict=True)
    )
    method = one_of("method", method, METHOD_NAMES)
    if not (settings is None or (isinstance(settings, Mapping) and all(isinstance(name, str) for name in settings))):
        raise SceneError.of("settings", f"must be a dictionary by names of settings, not {shown(settings)}")
    if settings and method == EXACT:
        raise SceneError(
            f"method {EXACT!r} has no settings: it is told by nodes, accuracy, algorithm and truncation", "method"
        )
    if method == AUTO and (settings or nodes is not None):
        name = "settings" if settings else "nodes"
        raise SceneError(f"method {AUTO!r} takes no {name}: it goes by accuracy; for {name} name the method", "method")
    if accuracy is None:
        accuracy = WITHOUT_NODES if nodes is None else WITH_NODES
    found = backend_of(one_of("backend", backend, BACKENDS))
    algorithm = one_of("algorithm", algorithm, ALGORITHMS)
    if algorithm == "modes" and found.linear_algebra == "device":
        raise SceneError(
            f"algorithm 'modes' needs an eigensolver, which backend {found.label!r} does not have: "
            "ask for algorithm 'auto', 'direct', 'doubling' or 'invariance', or for another backend",
            "algorithm",
        )
    return {
        "nodes": None if nodes is None else whole("nodes", nodes, 1, MOST_NODES),
        "accuracy": number("accuracy", accuracy, FINEST, COARSEST, f"between {FINEST:g} and {COARSEST:g}"),
        "algorithm": algorithm,
        "verify": flag("verify", verify),
        "truncation": one_of("truncation", truncation, CHOICES),
        "backend": found,
        "method": method,
        "settings": dict(settings or {}),
        "illuminate": one_of("illuminate", illuminate, SIDES),
        "given": given,
        "time_limit_s": number(
            "time_limit_s", TIME_LIMIT_S if time_limit_s is None else time_limit_s, 0.0, math.inf, "seconds"
        ),
    }


def brdf_request(
    scene: Any, mu_i: Any, mu_o: Any, phi: Any, transmission: Any, options: dict[str, Any]
) -> tuple[Request, Array]:
    """The request of a BRDF, and its outgoing cosines."""
    scene = lit_from(options["illuminate"], check_scene(scene))
    into, out = cosines("mu_i", mu_i), cosines("mu_o", mu_o)
    azimuths = vector("phi", phi)
    if flag("transmission", transmission) and not np.isfinite(scene.thickness):
        raise SceneError.of("transmission", "needs a finite thickness: nothing comes out below a layer without end")
    levels = np.array([0.0, scene.thickness] if transmission else [0.0])
    directions = np.concatenate([out, -out]) if transmission else out
    # light going up at the top, and light going down at the bottom
    parts = [
        (np.array([k], np.int32), np.arange(k * out.size, (k + 1) * out.size, dtype=np.int32))
        for k in range(levels.size)
    ]
    wanted = Wanted(parts, np.arange(4, dtype=np.int32), 1.0 / into)
    return Request("brdf", scene, into, np.eye(4), directions, azimuths, levels, wanted, **options), out


def radiance_request(
    scene: Any, mu0: Any, stokes: Any, mu: Any, phi: Any, tau: Any, options: dict[str, Any]
) -> tuple[Request, Array]:
    """The request of a field of one beam or several, and their incident Stokes vector."""
    scene = lit_from(options["illuminate"], check_scene(scene))
    beam = cosines("mu0", mu0)
    fluxes_only = isinstance(mu, (list, tuple)) and not mu
    directions = np.ones(1) if fluxes_only else None if mu is None else cosines("mu", mu, signed=True)
    incident, azimuths, levels = stokes_vector(stokes), vector("phi", phi), depths(tau, scene)
    arriving = incident
    if options["illuminate"] == "bottom":
        arriving, levels = mirrored_stokes(incident), scene.thickness - levels
        directions = None if directions is None else -directions
    parts = [arriving * [1, 1, 0, 0], arriving * [0, 0, 1, 1]]
    columns = np.array([part for part in parts if part.any()] or parts[:1])
    request = Request(
        "radiance", scene, beam, columns, directions, azimuths, levels, None, **options, fluxes_only=fluxes_only
    )
    return request, incident
