"""What a variation changes of a discrete problem: its truncated layers, the pieces they are cut into, its beams."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from vrte.basics.arrays import Array, record, replace_unchecked
from vrte.basics.differences import STEP, sample_around
from vrte.basics.errors import SceneError
from vrte.discrete_ordinates.orders.beam_paths import BeamPaths
from vrte.discrete_ordinates.orders.media import Cut, Media, find_beams, take_escapes, trace_sights
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.optics.truncation import expand_peak
from vrte.scene.beams import Passing
from vrte.scene.boundary import Boundary
from vrte.scene.scene import LEAST_STEP, Scene, build_like
from vrte.scene.vary import Variation

IMAGINARY = 1e-40  # imaginary step of a thickness (complex-step derivative): no difference is taken, no digit is lost
NEAR = 2.0**-6  # of the step of a whole solve's differences: the error of two points is then 1e-10
LEAST_LIGHT = (
    2.0**-12
)  # scattered: steps grow to 2^4 of those, since rounding is that of all light, not of what scatters
TWO_POINTS = ({-1: -0.5, 1: 0.5}, {0: -1.5, 1: 2.0, 2: -0.5})
FAR = 1e300  # optical thickness that stands for a semi-infinite layer


@record
class LayerChange:
    """Derivatives of a truncated layer: thickness, of stretch and gain as in `vrte.optics.truncation.Truncated`, and of
    the albedo times the coefficients, (terms, 6); ``whole`` (terms, 6): of all of its coefficients."""

    thickness: float
    stretch: float
    gain: float
    scattering: Array
    whole: Array


def change_layer(problem: Problem, scene: Scene, k: int, variation: Variation, carried: int) -> LayerChange:
    """How layer k changes, by the differentiated formulas of delta-M (`vrte.optics.truncation`), whether its
    peak is separated or not; the nodes carry ``carried`` terms."""
    layer, table = scene.layers[k], variation.coefficients[k]
    tau, albedo = layer.thickness, layer.albedo
    d_tau, d_albedo = float(variation.thickness[k]), float(variation.albedo[k])
    given = layer.phase_matrix.coefficients
    whole = np.zeros((max(given.shape[0], table.shape[0]), 6))
    whole[: table.shape[0]] = table
    rows = problem.coefficients.shape[1]
    cut, d_cut = np.zeros((rows, 6)), np.zeros((rows, 6))
    kept = int(problem.terms[k])
    f, d_f = float(problem.fraction[k]), 0.0
    if f > 0.0:
        d_f = float(whole[kept, 0]) / (2 * kept + 1) if whole.shape[0] > kept else 0.0  # those kept are all carried
    stretch = 1.0 - albedo * f
    d_stretch = -(d_albedo * f + albedo * d_f)
    count, d_count = min(kept, given.shape[0]), min(carried, rows, whole.shape[0])
    cut[:count], d_cut[:d_count] = given[:count], whole[:d_count]
    if f > 0.0:
        peak = np.zeros((rows, 6))
        peak[:kept] = expand_peak(kept)
        cut, d_cut = (
            (cut - f * peak) / (1.0 - f),
            (d_cut - d_f * peak) / (1.0 - f) + (cut - f * peak) * (d_f / (1.0 - f) ** 2),
        )
    own = albedo * (1.0 - f) / stretch
    d_own = (d_albedo * (1.0 - f) - albedo * d_f - own * d_stretch) / stretch
    finite = 0.0 if np.isinf(tau) else d_tau * stretch + tau * d_stretch
    d_gain = (d_albedo - albedo / stretch * d_stretch) / stretch
    return LayerChange(finite, d_stretch, d_gain, d_own * cut + own * d_cut, whole)


Moved = tuple[tuple[float, Media], ...]


@record
class Change:
    """A variation as the stack of a `BeamPaths` meets it: its layers; the pieces' thickness (piece,); the beams, as
    `Passing` of Mueller matrices, None where no thickness changes; media and interfaces a step away, whose weighted
    operators are the derivatives with all that is no layer."""

    variation: Variation
    layers: tuple[LayerChange, ...]
    pieces: Array
    beams: Passing | None
    moved: Moved

    @property
    def scatters(self) -> list[bool]:
        """Whether the scattering of each layer changes."""
        return [bool(layer.scattering.any()) for layer in self.layers]

    @property
    def base(self) -> Sequence[tuple[float, Boundary]]:
        """Weighted boundaries whose sum is the base's derivative; none where surfaces move, and the base with them."""
        return () if self.moved else [(weight, boundary) for weight, boundary in self.variation.base if weight]


def find_changes(
    beam_paths: BeamPaths, scene: Scene, variations: Sequence[Variation], carried: int, sources: Array
) -> list[tuple[Change, Array | None]]:
    """What each variation changes of a stack, and of what is seen of light that sets out along the sights from
    ``sources`` (source, 2), as `find_escapes` has it; None where no thickness changes. All beams go together."""
    problem, media, sights = beam_paths.problem, beam_paths.media, beam_paths.sights
    layers = [
        tuple(change_layer(problem, media.scene, k, one, carried) for k in range(len(media.scene.layers)))
        for one in variations
    ]
    pieces = [change_pieces(beam_paths, *pair) for pair in zip(variations, layers, strict=True)]
    moved = [k for k, each in enumerate(pieces) if each.any()]
    beams: dict[int, Passing] = {}
    escapes: dict[int, Array] = {}
    if moved:
        cut = stretch_pieces(beam_paths.cut, np.stack([pieces[k] for k in moved]))
        _, passing = find_beams(media, cut, problem.mu0)
        each = [np.split(part.imag / IMAGINARY, len(moved), axis=1) for part in vars(passing).values()]
        beams = {k: Passing(*parts) for k, *parts in zip(moved, *each, strict=True)}
        traced = trace_sights(media, cut, sights.cosines).imag / IMAGINARY
        escapes = {
            k: take_escapes(part, sights, problem.n_up, list(ALL), sources)
            for k, part in zip(moved, np.split(traced, len(moved), axis=4), strict=True)
        }
    lowest = find_lowest(problem)
    surfaces = [move_media(media, sample_surfaces(scene, one, lowest)) for one in variations]
    return [
        (Change(one, layers[k], pieces[k], beams.get(k), surfaces[k]), escapes.get(k))
        for k, one in enumerate(variations)
    ]


def moves_surfaces(variation: Variation) -> bool:
    """Whether a variation moves media or surfaces, a base that mirrors beams among them."""
    mirrors = any(boundary.keeps_beams for weight, boundary in variation.base if weight)
    return variation.is_outside or (mirrors and variation.scene_at is not None)


def find_lowest(problem: Problem) -> float:
    """The lowest cosine of a problem's beams and outgoing directions."""
    return float(min(problem.mu0.min(), problem.mu_out.min(initial=1.0)))


@lru_cache(maxsize=32)
def sample_surfaces(scene: Scene, variation: Variation, lowest: float) -> tuple[tuple[float, Scene], ...]:
    """Weights and scenes around one, if a variation moves its surfaces; ``lowest`` as of `find_whole_step`."""
    if not moves_surfaces(variation):
        return ()
    assert variation.scene_at is not None
    scattered = sum(layer.albedo * min(layer.thickness, 1.0) for layer in scene.layers) + scene.below.orders_reflected
    step = NEAR * find_whole_step(scene, variation, lowest) / np.cbrt(min(max(scattered, LEAST_LIGHT), 1.0))
    return tuple(sample_around(variation.scene_at, variation.value, step, TWO_POINTS))


def find_whole_step(scene: Scene, variation: Variation, lowest: float) -> float:
    """How far to go with the number itself: a small share of it, of what two media that it moves differ by, and of what
    bends the light of the flattest direction, of cosine ``lowest``, along a medium that it moves."""
    assert variation.scene_at is not None
    step = STEP * (abs(variation.value) or 1.0)
    media = np.array(scene.media)
    outside = media[0]
    for way in (step, -step):
        try:
            after = np.array(variation.scene_at(variation.value + way).media)
        except SceneError:  # a bound, or too far already: steps from there on say which
            continue
        bent = np.abs(media**2 - outside**2 * (1.0 - lowest**2)) / (2.0 * media)
        room = np.concatenate([np.abs(np.diff(media)), np.maximum(bent, 4.0 * LEAST_STEP / STEP)])
        moved = np.abs(np.concatenate([np.diff(after - media), after - media - (after[0] - outside)]))
        close = (moved > 0.0) & (room > 0.0)
        return float(min(step, (step * STEP * room[close] / moved[close]).min(initial=np.inf)))
    return step


def find_surface_gap(scene: Scene, variation: Variation, lowest: float) -> str | None:
    """Why samples of surfaces do not tell how a scene changes; None where they do."""
    try:
        samples = sample_surfaces(scene, variation, lowest)
    except SceneError:
        return "two media of one index part, or a bound is near"
    below = scene.below
    for _, one in samples:
        if [kind and kind.is_smooth for kind in one.interfaces] != [
            kind and kind.is_smooth for kind in scene.interfaces
        ]:
            return "an interface comes or goes"
        if len({*zip(scene.media, one.media, strict=True)}) > len({*scene.media}):
            return "two media of one index part, or a bound is near"
        if (one.below.orders_reflected, one.below.mixes_stokes) != (below.orders_reflected, below.mixes_stokes):
            return "the base becomes another one"
    return None


def move_media(media: Media, samples: Sequence[tuple[float, Scene]]) -> Moved:
    """Media whose surfaces are those of weighted scenes, their layers the same."""
    own, found = media.scene, []
    for weight, scene in samples:
        layers = [layer.put_in_medium(index) for layer, index in zip(own.layers, scene.media[1:], strict=False)]
        base, surfaces = None if own.base is None else scene.base, scene.interfaces[: len(layers) + 1]
        moved = build_like(own, layers, base, surfaces)
        nodes = media.nodes.move(dict(zip(own.media, moved.media, strict=True)))
        found.append((weight, Media(moved, nodes, media.depths, media.oriented)))
    return tuple(found)


def move_problem(problem: Problem, media: Media) -> Problem:
    """A problem in other media."""
    nodes, weights = media.nodes.carried(max(media.scene.media))
    return replace_unchecked(problem, media=media, nodes=nodes, weights=weights)


def change_pieces(beam_paths: BeamPaths, variation: Variation, layers: tuple[LayerChange, ...]) -> Array:
    """Derivatives of the pieces' thickness, (piece,): a depth inside a layer stays where it is below the top of all,
    the faces of layers move."""
    problem, depths = beam_paths.problem, beam_paths.media.depths
    true_top = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(variation.thickness), variation.thickness, 0.0))])
    found = np.zeros(beam_paths.cut.layer.size)
    stretch = np.where(problem.albedo > 0.0, 1.0 - problem.fraction * find_albedo(beam_paths), 1.0)
    for k, layer in enumerate(layers):
        own = np.flatnonzero(beam_paths.cut.layer == k)
        here = (depths.interface < 0) & (depths.layer == k)
        levels = np.unique(problem.level[here])
        true = levels / stretch[k]
        moved = layer.stretch * true - stretch[k] * true_top[k]
        inside = own.size - 1
        edges = np.concatenate([[0.0], moved[levels > 0.0][:inside], [layer.thickness]])
        found[own] = np.diff(edges)
        if np.isinf(problem.thickness[k]):
            found[own[-1]] = 0.0
    return found


def find_albedo(beam_paths: BeamPaths) -> Array:
    """The albedos of the layers as they are, (layer,)."""
    return np.array([layer.albedo for layer in beam_paths.media.scene.layers])


def stretch_pieces(cut: Cut, pieces: Array) -> Cut:
    """The pieces with what changes of them, pieces (several, piece), as an imaginary part."""
    finite = np.where(np.isinf(cut.thickness), FAR, cut.thickness)
    return replace_unchecked(cut, thickness=finite[:, None] + 1j * IMAGINARY * pieces.T)
