"""What a variation changes of a discrete problem: its truncated layers, the pieces they are cut into, its beams."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from vrte.basics.arrays import Array, record
from vrte.basics.differences import sample_around
from vrte.discrete_ordinates.orders.beam_paths import BeamPaths
from vrte.discrete_ordinates.orders.media import Cut, find_beams, take_escapes, trace_sights
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.optics.truncation import expand_peak
from vrte.scene.beams import Passing
from vrte.scene.interface import Interface
from vrte.scene.scene import Scene
from vrte.scene.vary import BASE_STEP, LEAST_SCALE, Variation

STEP = 1e-40  # imaginary step of a thickness (complex-step derivative): no difference is taken, no digit is lost
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


ChangedInterfaces = Mapping[int, tuple[tuple[float, Interface], ...]]


@record
class Change:
    """A variation as the stack of a `BeamPaths` meets it: its layers; the pieces' thickness (piece,); the beams, as
    `Passing` of Mueller matrices, None where no thickness changes; by number the rough interfaces whose weighted sums
    are the derivatives of those that change."""

    variation: Variation
    layers: tuple[LayerChange, ...]
    pieces: Array
    beams: Passing | None
    interfaces: ChangedInterfaces

    @property
    def scatters(self) -> list[bool]:
        """Whether the scattering of each layer changes."""
        return [bool(layer.scattering.any()) for layer in self.layers]


def find_changes(
    beam_paths: BeamPaths, variations: Sequence[Variation], carried: int, sources: Array
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
        each = [np.split(part.imag / STEP, len(moved), axis=1) for part in vars(passing).values()]
        beams = {k: Passing(*parts) for k, *parts in zip(moved, *each, strict=True)}
        traced = trace_sights(media, cut, sights.cosines).imag / STEP
        escapes = {
            k: take_escapes(part, sights, problem.n_up, list(ALL), sources)
            for k, part in zip(moved, np.split(traced, len(moved), axis=4), strict=True)
        }
    facets = [list_changed_interfaces(media.scene, one) or {} for one in variations]
    return [
        (Change(one, layers[k], pieces[k], beams.get(k), facets[k]), escapes.get(k)) for k, one in enumerate(variations)
    ]


def list_changed_interfaces(scene: Scene, variation: Variation) -> ChangedInterfaces | None:
    """By number, weights and rough interfaces whose weighted sums are the derivatives of those that change with what is
    neither layer nor base; None where more changes: a medium, or what is smooth."""
    if not variation.is_outside:
        return {}
    assert variation.scene_at is not None
    step = BASE_STEP * max(abs(variation.value), LEAST_SCALE)
    scenes = sample_around(variation.scene_at, variation.value, step)
    found: dict[int, tuple[tuple[float, Interface], ...]] = {}
    for k, own in enumerate(scene.interfaces):
        others = [(weight, one.interfaces[k]) for weight, one in scenes]
        if all(other == own for _, other in others):
            continue
        rough = tuple((weight, other) for weight, other in others if other is not None and not other.is_smooth)
        if own is None or own.is_smooth or len(rough) < len(others):
            return None
        found[k] = rough
    return found if all(one.media == scene.media for _, one in scenes) else None


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
    return replace(cut, thickness=finite[:, None] + 1j * STEP * pieces.T)
