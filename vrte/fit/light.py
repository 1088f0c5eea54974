"""The light that rows of a measurement are read off: which solves find it, as few as will do, and what they find."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, make_readonly
from vrte.basics.differences import STEP, sample_around
from vrte.basics.errors import SceneError
from vrte.fit.quantities import BeamShares
from vrte.request.request import Request, make_brdf_request, make_radiance_request
from vrte.results.result import Solution
from vrte.scene.beams import find_direct_light, locate_depths
from vrte.scene.illumination import mirror_mueller
from vrte.scene.scene import Scene
from vrte.scene.vary import Variation, move_scene, turn_variation

MOST_TOGETHER = 200_000  # pairs of directions of a solve; where there are more, each incidence has a solve of its own

Triple = tuple[bool, float, float, float]  # whether through, cosines of incidence and exit, azimuth


@dataclass(eq=False)
class Sight:
    """Pairs of directions and beams that rows look at in one scene, each with its place in what is `Seen`."""

    triples: dict[Triple, int] = field(default_factory=dict)
    beams: dict[float, int] = field(default_factory=dict)
    through: bool = False

    def add_triple(self, through: bool, mu_i: float, mu_o: float, phi: float) -> int:
        """The place of a pair of directions; along the normal there is no azimuth."""
        self.through |= through
        azimuth = 0.0 if mu_o == 1.0 and mu_i == 1.0 else phi % 360.0
        return self.triples.setdefault((through, mu_i, mu_o, azimuth), len(self.triples))

    def add_beam(self, mu: float, through: bool) -> int:
        """The place of an incident direction."""
        self.through |= through
        return self.beams.setdefault(mu, len(self.beams))

    @property
    def axes(self) -> tuple[Array, ...]:
        """Cosines of incidence and of exit and azimuths [degrees] of the solve, each ascending."""
        incident, out, turned = ({one[index] for one in self.triples} for index in (1, 2, 3))
        return tuple(np.array(sorted(one)) for one in (incident | {*self.beams}, out, turned))

    def split(self) -> list["Sight"]:
        """The sights of one solve each: this one, or one for each incidence where there are too many directions."""
        if np.prod([axis.size for axis in self.axes]) <= MOST_TOGETHER:  # none, of beams alone
            return [self]
        return [
            Sight(
                {one: index for one, index in self.triples.items() if one[1] == mu},
                {one: index for one, index in self.beams.items() if one == mu},
                self.through,
            )
            for mu in self.axes[0].tolist()
        ]

    def ask(self, scene: Scene, options: dict[str, Any]) -> Request:
        """The request that a scene is solved by. Raises SceneError."""
        if self.through and not np.isfinite(scene.thickness):
            raise SceneError("transmittance was measured, and nothing comes out below a semi-infinite layer")
        mu_i, mu_o, phi = self.axes
        if self.triples:
            return make_brdf_request(scene, mu_i, mu_o, phi, transmission=self.through, **options)
        request = make_radiance_request(scene, mu_i, mu=[], **options)
        levels = np.array([0.0, request.scene.thickness] if self.through else [0.0])
        return replace(request, tau=make_readonly(levels), asked_tau=None, under=np.arange(levels.size) > 0)

    def read(self, request: Request, found: Solution) -> tuple[Array, Array, Array]:
        """Mueller matrices (triple, 4, 4), and shares (beam,) of scattered light that come back and get through, of a
        solution or a derivative of one."""
        axes, matrices = self.axes, np.zeros((len(self.triples), 4, 4))
        if self.triples:
            faces = [part[0] for part in found.parts]
            if request.illuminate == "bottom":
                faces = [mirror_mueller(part) for part in faces]
            for index, (through, *where) in enumerate(self.triples):
                at = tuple(int(np.searchsorted(axis, one)) for axis, one in zip(axes, where, strict=True))
                matrices[index] = faces[through][at]
        indices = np.searchsorted(axes[0], np.array([*self.beams]))
        mu = axes[0][indices]
        up = found.flux_up[0, indices, 0] / mu
        down = found.flux_down[1, indices, 0] / mu if self.through else np.zeros_like(up)
        return matrices, up, down

    def follow_beams(self, scene: Scene) -> Array:
        """Shares (2, beam) that are mirrored, and get through, as beams; ``scene`` as it is lit from above."""
        mu, found = np.array([*self.beams]), np.zeros((2, len(self.beams)))
        if mu.size and not scene.needs_beam_paths:
            found[1] = np.exp(-scene.thickness / mu)
        elif mu.size:
            ends = np.array([0.0, scene.thickness])[: 1 + bool(np.isfinite(scene.thickness))]
            direct = find_direct_light(scene, mu, locate_depths(scene, ends, np.arange(ends.size) > 0))
            found[: ends.size] = [direct[side, :, side, 0, 0] for side in range(ends.size)]
        return found


Solved = tuple[Sight, Request, Solution, list[Solution], list[Variation]]  # with derivatives, one a variation


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
    scene, and how it changes with each number."""

    matrices: Array
    shares: BeamShares
    scene: Scene
    variations: Sequence[Variation]


def read_sight(sight: Sight, solved: Sequence[Solved]) -> Seen:
    """What the solves of a sight's groups found, as jets at the places that rows know."""
    _, request, _, slopes, variations = solved[0]
    turned = [turn_variation(one) for one in variations] if request.illuminate == "bottom" else variations
    matrices = np.zeros((1 + len(slopes), len(sight.triples), 4, 4))
    shares = BeamShares(*np.zeros((4, 1 + len(slopes), len(sight.beams))))
    for part, asked, value, changes, _ in solved:
        found, up, down = (
            np.stack(some) for some in zip(*(part.read(asked, one) for one in (value, *changes)), strict=True)
        )
        matrices[:, [*part.triples.values()]] = found
        beams = make_scene_jet(part.follow_beams, asked.scene, turned, part.axes[0].min())
        for whole, one in zip(shares, (up, down, beams[:, 0], beams[:, 1]), strict=True):
            whole[:, [*part.beams.values()]] = one
    return Seen(matrices, shares, request.scene, turned)
