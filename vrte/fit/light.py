"""The light that rows of a measurement are read off: which solves find it, as few as will do, and what they find."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, settle_array
from vrte.basics.differences import STEP, sample_around
from vrte.basics.errors import SceneError
from vrte.fit.quantities import Shares
from vrte.request.request import Request, make_brdf_request, make_radiance_request
from vrte.results.solution import Solution
from vrte.scene.beams import find_direct_light, locate_depths
from vrte.scene.illumination import mirror_mueller
from vrte.scene.scene import Scene
from vrte.scene.variation import Variation
from vrte.scene.vary import move_scene

MOST_TOGETHER = 200_000  # pairs of directions of a solve; where there are more, each incidence has a solve of its own

Triple = tuple[bool, float, float, float]  # whether through, cosines of incidence and exit, azimuth


@dataclass(eq=False)
class Sight:
    """What is looked at in one scene: pairs of directions and beams, each with its place, as rows ask for them."""

    triples: dict[Triple, int] = field(default_factory=dict)
    beams: dict[float, int] = field(default_factory=dict)
    through: bool = False

    def add_triple(self, through: bool, mu_i: float, mu_o: float, phi: float) -> int:
        """The place of a pair of directions; along the normal there is no azimuth."""
        self.through |= through
        azimuth = 0.0 if mu_o == 1.0 and mu_i == 1.0 else phi % 360.0
        return self.triples.setdefault((through, mu_i, mu_o, azimuth), len(self.triples))

    def add_beam(self, mu: float, through: bool) -> int:
        """Which of the incident directions a beam comes along."""
        self.through |= through
        return self.beams.setdefault(mu, len(self.beams))

    def group(self) -> list["Group"]:
        """The solves: all directions together where they are not too many, else one for each incidence."""
        if not self.triples:
            return [Group((), tuple(self.beams), self.through)]
        incident = {mu for _, mu, _, _ in self.triples} | {*self.beams}
        out, turned = ({one[place] for one in self.triples} for place in (2, 3))
        if len(incident) * len(out) * len(turned) <= MOST_TOGETHER:
            return [Group(tuple(self.triples), tuple(self.beams), self.through)]
        groups = []
        for mu in sorted(incident):
            triples = tuple(one for one in self.triples if one[1] == mu)
            groups.append(Group(triples, (mu,) if mu in self.beams else (), self.through))
        return groups


@dataclass(frozen=True, eq=False)
class Group:
    """The directions of one solve."""

    triples: tuple[Triple, ...]
    beams: tuple[float, ...]
    through: bool

    @property
    def mu_i(self) -> Array:
        return np.array(sorted({mu for _, mu, _, _ in self.triples} | {*self.beams}))

    @property
    def mu_o(self) -> Array:
        return np.array(sorted({mu for _, _, mu, _ in self.triples}))

    @property
    def phi(self) -> Array:
        return np.array(sorted({phi for *_, phi in self.triples}))

    def ask(self, scene: Scene, options: dict[str, Any]) -> Request:
        """The request that a scene is solved by. Raises SceneError."""
        if self.through and not np.isfinite(scene.thickness):
            raise SceneError("transmittance was measured, and nothing comes out below a layer without end")
        if self.triples:
            return make_brdf_request(scene, self.mu_i, self.mu_o, self.phi, transmission=self.through, **options)
        request = make_radiance_request(scene, self.mu_i, mu=[], **options)
        levels = np.array([0.0, request.scene.thickness] if self.through else [0.0])
        return replace(request, tau=settle_array(levels), asked_tau=None, under=np.arange(levels.size) > 0)

    def read(self, request: Request, found: Solution) -> tuple[Array, Array, Array]:
        """Mueller matrices (triple, 4, 4), and shares (beam,) of scattered light that come back and get through, of a
        solution or a derivative of one."""
        matrices = np.zeros((len(self.triples), 4, 4))
        if self.triples:
            faces = [part[0] for part in found.parts]
            if request.illuminate == "bottom":
                faces = [mirror_mueller(part) for part in faces]
            axes = (self.mu_i, self.mu_o, self.phi)
            for place, (through, *where) in enumerate(self.triples):
                at = tuple(int(np.searchsorted(axis, one)) for axis, one in zip(axes, where, strict=True))
                matrices[place] = faces[through][at]
        places = np.searchsorted(self.mu_i, np.array(self.beams))
        mu = self.mu_i[places]
        up = found.flux_up[0, places, 0] / mu
        down = found.flux_down[1, places, 0] / mu if self.through else np.zeros_like(up)
        return matrices, up, down

    def make_beam_jets(self, scene: Scene, variations: Sequence[Variation]) -> Array:
        """Jets (1 + n, 2, beam) of the shares that are mirrored, and get through, as beams; ``scene`` and
        ``variations`` as they are lit from above."""
        return make_scene_jet(lambda given: np.stack(self.follow_beams(given)), scene, variations, self.mu_i.min())

    def follow_beams(self, scene: Scene) -> tuple[Array, Array]:
        """Shares (beam,) that are mirrored, and get through, as beams; ``scene`` as it is lit from above."""
        mu = np.array(self.beams)
        if not mu.size:
            return np.zeros(0), np.zeros(0)
        if not scene.keeps_beams:
            return np.zeros_like(mu), np.exp(-scene.thickness / mu)
        ends = np.array([0.0, scene.thickness])[: 1 + bool(np.isfinite(scene.thickness))]
        direct = find_direct_light(scene, mu, locate_depths(scene, ends, np.arange(ends.size) > 0))
        return direct[0, :, 0, 0, 0], direct[1, :, 1, 0, 0] if ends.size > 1 else np.zeros_like(mu)


def make_scene_jet(
    find: Callable[[Scene], Array], scene: Scene, variations: Sequence[Variation], lowest: float
) -> Array:
    """Jets (1 + n, ...) of what depends on a scene in closed form, by differences of five points; ``lowest``: the
    cosine of the flattest direction."""
    thickness = np.array([layer.thickness for layer in scene.layers])
    value = find(scene)
    found = [value]
    for one in variations:
        rate = float((np.abs(one.thickness) / (np.minimum(thickness, 1e300) + lowest)).max())
        if one.is_outside and one.scene_at is not None:
            points = sample_around(one.scene_at, one.value, STEP * (abs(one.value) or 1.0))
        elif rate:
            along = replace(one, albedo=0.0 * one.albedo, coefficients=(), base=())  # all that beams meet
            points = sample_around(partial(move_scene, scene, along), 0.0, STEP / rate)
        else:
            points = []
        found.append(sum((weight * find(point) for weight, point in points), np.zeros_like(value)))
    return np.stack(found)


@dataclass(frozen=True, eq=False)
class Seen:
    """Jets (1 + n, ...) of what a `Sight` looks at: Mueller matrices (1 + n, triple, 4, 4), shares of beams; and the
    scene, how it changes with each number, and the flattest direction's cosine."""

    matrices: Array
    shares: Shares
    scene: Scene
    variations: Sequence[Variation]
    lowest: float


def join_groups(
    sight: Sight,
    groups: Sequence[Group],
    found: Sequence[tuple[Array, Shares]],
    scene: Scene,
    variations: Sequence[Variation],
) -> Seen:
    """What the solves of a sight found, at the places that rows know."""
    first = found[0][0].shape[0]
    matrices = np.zeros((first, len(sight.triples), 4, 4))
    shares = Shares(*(np.zeros((first, len(sight.beams))) for _ in Shares._fields))
    for group, (part, some) in zip(groups, found, strict=True):
        matrices[:, [sight.triples[one] for one in group.triples]] = part
        places = [sight.beams[one] for one in group.beams]
        for whole, one in zip(shares, some, strict=True):
            whole[:, places] = one
    return Seen(matrices, shares, scene, variations, min(float(group.mu_i.min()) for group in groups))
