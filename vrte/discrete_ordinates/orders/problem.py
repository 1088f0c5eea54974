"""The discrete problem every stage works on: arrays only, no class of the scene."""

from functools import cache, cached_property
from typing import Any, TypedDict

import numpy as np

from vrte.basics.arrays import Array, IntArray, record, replace_unchecked
from vrte.basics.polarization import FLIP
from vrte.discrete_ordinates.orders.media import Media
from vrte.discrete_ordinates.orders.skip_flags import EVERYTHING, SkipFlags
from vrte.scene.oriented import Oriented, find_slants

ALL = (0, 1, 2, 3)  # indices of I, Q, U, V


class PhaseArguments(TypedDict):
    """What loops of the core that know of phase matrices are told of a problem, by their names for it."""

    members: IntArray
    coefficients: Array
    terms: IntArray
    albedo: Array
    directions: Array
    weights: Array
    n_out: int


@record
class Problem:
    """Layers, directions and incident beams in the solver's frame (docs/reference/conventions.md).

    coefficients (layer, term, 6), truncated to 2 N terms; terms, albedo, thickness, above (layer,), of the truncated
    layers like all depths; gain, fraction (layer,): as in `vrte.optics.truncation.Truncated`; nodes, weights (N,);
    mu_out (n_out,) positive, the first ``n_up`` for light going up; mu0 (n_in,); columns (n_col, S) incident Stokes
    vectors; stokes (S,): places of the S Stokes parameters at work, ascending; terms_cut: how many terms of the longest
    phase matrix the nodes do not carry; level, level_layer (n_tau,): depths below the top of a layer; skip_flags: what
    need not be done. ``media``: where light is refracted or mirrored between the layers, None where it goes straight
    on; nodes are then those of the densest medium, mu0 and mu_out in the media that the light is in. ``grading``:
    of the nodes, see `make_double_gauss`. Layers and levels of several ``scenes``, with as many of them each, lie one
    behind another; level_layer (n_tau,) is that of all. ``oriented`` (layer,): flakes of each layer, if any has them;
    its albedo is then the largest over all directions, and its coefficients are less by what flakes have of it."""

    coefficients: Array
    terms: IntArray
    albedo: Array
    thickness: Array
    above: Array
    gain: Array
    fraction: Array
    nodes: Array
    weights: Array
    mu_out: Array
    n_up: int
    mu0: Array
    columns: Array
    level: Array
    level_layer: IntArray
    stokes: tuple[int, ...] = ALL
    terms_cut: int = 0
    skip_flags: SkipFlags = EVERYTHING
    media: Media | None = None
    grading: int = 1
    scenes: int = 1
    oriented: tuple[Oriented | None, ...] = ()

    @property
    def is_exact(self) -> bool:
        """Whether the nodes integrate the phase matrices' terms exactly: Gauss's do, those that several media share do
        not, graded ones so many terms that l grading + grading - 1 < 2 N."""
        one_medium = self.media is None or len(self.media.nodes.panels) == 1
        return one_medium and (self.grading == 1 or self.coefficients.shape[1] * self.grading <= 2 * self.nodes.size)

    @cached_property
    def directions(self) -> Array:
        """Nodes, then outgoing, then incident cosines."""
        return np.concatenate([self.nodes, self.mu_out, self.mu0])

    @cached_property
    def slants(self) -> dict[str, Any]:
        """mu/k along all directions in each layer, as the core takes them; nothing where no layer has flakes."""
        if not any(self.oriented):
            return {}
        layers = len(self.oriented)
        named = {"slant_nodes": self.nodes, "slant_in": self.mu0, "slant_out": self.mu_out}
        found: dict[str, Any] = {
            name: find_slants(self.oriented, np.tile(mu, (layers, 1))) for name, mu in named.items()
        }
        return found | {"oriented": np.array([one is not None for one in self.oriented], np.int32)}

    @cached_property
    def phase_arguments(self) -> PhaseArguments:
        """Stokes parameters, layers and directions, as the core takes them."""
        return PhaseArguments(
            members=self.members,
            coefficients=self.coefficients,
            terms=self.terms,
            albedo=self.albedo,
            directions=self.directions,
            weights=self.weights,
            n_out=self.mu_out.size,
        )

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of an order as the core names them."""
        return {
            "stokes": len(self.stokes),
            "n_node": self.nodes.size,
            "n_out": self.mu_out.size,
            "n_in": self.mu0.size,
            "n_col": self.columns.shape[0],
            "n_layer": self.albedo.size,
            "n_term": self.coefficients.shape[1],
        }

    @cached_property
    def clear_layers(self) -> IntArray:
        """1 where nothing scatters and no modes are needed, (scene layer,)."""
        return ((self.albedo == 0.0) & self.skip_flags.clear).astype(np.int32)

    @cached_property
    def off_nodes(self) -> tuple[Array, IntArray]:
        """Outgoing and incident cosines, each once and ascending, and the place of every one of them."""
        cosines, indices = np.unique(np.concatenate([self.mu_out, self.mu0]), return_inverse=True)
        return cosines, indices.astype(np.int32)

    @cached_property
    def depth(self) -> Array:
        """Optical depths of the levels below the top, (scene n_tau,), as the truncated layers have them."""
        top = self.above.reshape(self.scenes, -1)[:, self.level_layer]
        return (top + self.level.reshape(self.scenes, -1)).ravel()

    def select_scene(self, index: int) -> "Problem":
        """The problem of one of its scenes."""
        if self.scenes == 1:
            return self
        layers, levels = (slice(index * k, (index + 1) * k) for k in (self.layers, self.level_layer.size))
        names = "coefficients", "terms", "albedo", "thickness", "above", "gain", "fraction"
        own = {name: getattr(self, name)[layers] for name in names}
        return replace_unchecked(self, scenes=1, level=self.level[levels], **own)

    def select_stokes(self, stokes: tuple[int, ...], columns: Array) -> "Problem":
        """The problem of some Stokes parameters and the incident ``columns`` (n_col, S) of these."""
        found = object.__new__(Problem)
        vars(found).update(vars(self), stokes=stokes, columns=columns)
        vars(found).pop("phase_arguments", None)  # what is found of a problem and depends on them
        return found

    @property
    def layers(self) -> int:
        """How many layers each scene has."""
        return self.albedo.size // self.scenes

    @property
    def size(self) -> int:
        """n = S N."""
        return len(self.stokes) * self.nodes.size

    @property
    def rows_out(self) -> int:
        """S n_out."""
        return len(self.stokes) * self.mu_out.size

    @property
    def members(self) -> IntArray:
        """The Stokes parameters at work, (S,)."""
        return find_members(self.stokes)[0]

    @property
    def flip(self) -> Array:
        """D of (1:11) on the Stokes parameters at work: the Delta of (1:26)-(1:27), node by node."""
        return find_members(self.stokes)[1]

    @cached_property
    def is_scalar(self) -> bool:
        """Whether I alone is scattered."""
        return not (np.count_nonzero(self.coefficients[..., 1:]) or any(self.oriented))

    @property
    def is_symmetric(self) -> bool:
        """Whether E and F are symmetric: U and V do not mix."""
        if 2 not in self.stokes or 3 not in self.stokes:
            return True
        return not (np.count_nonzero(self.coefficients[..., 5]) or any(self.oriented))

    @property
    def conserves(self) -> bool:
        """Whether order 0 carries the flux."""
        return self.stokes[0] == 0

    @property
    def n_rhs(self) -> int:
        """Right-hand sides of every order."""
        return int(self.mu0.size * self.columns.shape[0])


@cache
def find_members(stokes: tuple[int, ...]) -> tuple[IntArray, Array]:
    """The Stokes parameters, (S,), and D of (1:11) on them."""
    members, flip = np.array(stokes, np.int32), FLIP[list(stokes)]
    for each in (members, flip):
        each.setflags(write=False)
    return members, flip
