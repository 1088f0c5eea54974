"""The light that a sphere sends to the camera: for each normal, an integral over all directions light comes from.

A sphere is convex, and nothing stands in its light: what leaves a point depends on its normal alone,

    L(n) = integral over k with -k.n > 0 of  R_camera f(mu_i, mu_o, phi) R_facet L_sky(k) (-k.n) dk
           + R_camera f(sun) (1, 0, 0, 0) E_sun (-k_sun.n),

f the BRDF (4x4), R turns of Stokes axes. The sky's part is smooth over the sphere: it is computed on rings of normals
around the line of sight and splined; the sun's ends at a sharp edge: it is computed for each pixel. What a smooth
surface mirrors is added pixel by pixel, what a rough one does facet by facet (gloss.py).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.splines import compute_coefficients, extend_azimuths, make_spline_matrix, repeat_grid
from vrte.optics.facets import RoughSurface
from vrte.render.geometry import UP, Camera, compute_normals, convert_to_polar, find_turn, turn_stokes
from vrte.render.gloss import Gloss, RoughGloss
from vrte.render.sky import Sky, make_horizon_angles
from vrte.results.brdf import Brdf

STEEPEST = 1e-3  # smallest cosine of a BRDF's table; light that grazes even more is given the value there
MARGIN = 0.94  # of a square picture's half side: the sphere's radius


@dataclass(frozen=True)
class Resolution:
    """How finely things are known, for an error of about 1e-3 of a picture's largest value (docs/how_to/render.md).

    ``angles`` and ``azimuths``: the BRDF's table. ``around``: normals on a ring, there is a ring for each ``angles``.
    ``along``, ``across``: nodes of the quadrature over a lune of the sky, and over one of the ground.
    """

    angles: int = 32
    azimuths: int = 120
    around: int = 48
    along: int = 24
    across: int = 16

    @property
    def theta(self) -> Array:
        """Angles [rad] from the normal of the BRDF's table, incoming and outgoing."""
        return make_horizon_angles(self.angles, STEEPEST)

    @property
    def mu(self) -> Array:
        """Their cosines."""
        return np.clip(np.cos(self.theta), STEEPEST, 1.0)

    @property
    def phi(self) -> Array:
        """Azimuths [deg] of the table: half a turn, the other half is its mirror image."""
        return np.asarray(np.arange(self.azimuths // 2 + 1) * (360.0 / self.azimuths), dtype=np.float64)

    @property
    def turn(self) -> Array:
        """The table's azimuths [rad] once around, and beyond both ends."""
        return make_steps_around(self.azimuths)[0]


@dataclass(frozen=True, eq=False)
class Table:
    """A BRDF over `Resolution.theta` twice and azimuths all around: ``splines`` (theta_i, theta_o, phi, 16).

    What is splined is f over what a slab of this optical ``thickness`` sends back of single scattering,
    (1 - exp(-thickness (1/mu_i + 1/mu_o)))/(mu_i + mu_o): that is steep where light grazes, and most of it.
    ``specular`` (theta, 16): splines of the share that comes back as a beam, None where none does; ``facets``: the
    rough surface on top, whose own reflection is not in ``splines``.
    """

    splines: Array
    thickness: float
    resolution: Resolution
    specular: Array | None = None
    facets: RoughSurface | None = None

    def slab(self, mu_i: Array, mu_o: Array) -> Array:
        """That factor; 1/(mu_i + mu_o) for a bare base."""
        share = -np.expm1(-self.thickness * (1.0 / mu_i + 1.0 / mu_o)) if self.thickness else 1.0
        return np.asarray(share / (mu_i + mu_o))

    def rows(self, mu_i: Array, mu_o: Array, phi: Array) -> Any:
        """The matrix from the flat splines to directions (n,), phi in radians."""
        grids = self.resolution.theta, self.resolution.theta, self.resolution.turn
        return make_spline_matrix(grids, (np.arccos(mu_i), np.arccos(mu_o), phi % (2.0 * np.pi)))

    def mueller(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
        """f (n, 4, 4) [1/sr] in directions (n,), phi in radians."""
        found: Array = self.rows(mu_i, mu_o, phi) @ self.splines.reshape(-1, 16)
        return (found * self.slab(mu_i, mu_o)[:, None]).reshape(-1, 4, 4)

    def mirror(self, mu: Array) -> Array:
        """The share (n, 4, 4) that comes back as a beam of light along mu (n,)."""
        found: Array = make_spline_matrix((self.resolution.theta,), (np.arccos(mu),)) @ self.specular
        return found.reshape(-1, 4, 4)


def tabulate_brdf(brdf: Brdf, resolution: Resolution, facets: RoughSurface | None = None) -> Table:
    """The table of a BRDF for the directions of ``resolution``; of ``facets`` its own part is left out."""
    assert brdf.direct_transmittance is not None
    thickness = float(-np.log(brdf.direct_transmittance[0])) if brdf.direct_transmittance[0] else np.inf
    plain = Table(np.empty(0), thickness, resolution)
    half = leave_out_facets(brdf, facets) / plain.slab(brdf.mu_i[:, None], brdf.mu_o)[:, :, None, None, None]
    _, full = extend_azimuths(brdf.phi, half)
    grids = resolution.theta, resolution.theta, resolution.turn
    splines = compute_coefficients(grids, full.reshape(*full.shape[:3], 16))
    beams = brdf.specular
    specular = None if beams is None else compute_coefficients(grids[:1], beams.reshape(-1, 16))
    return replace(plain, splines=splines, specular=specular, facets=facets)


def leave_out_facets(brdf: Brdf, facets: RoughSurface | None) -> Array:
    """The Mueller matrices of a BRDF without what these facets reflect, each by itself."""
    if facets is None:
        return brdf.mueller
    return brdf.mueller - facets.reflect(brdf.mu_i[:, None, None], brdf.mu_o[:, None], brdf.phi)


def make_steps_around(count: int) -> tuple[Array, Any]:
    """Equal steps of one turn [rad] and beyond both ends, and which of ``count`` each is."""
    return repeat_grid(np.arange(count, dtype=np.float64) * (2.0 * np.pi / count))


@dataclass(frozen=True, eq=False)
class View:
    """What pictures of spheres have in common, whatever the wavelength and the material: directions.

    ``size`` is the side of the square picture [pixels].
    """

    camera: Camera
    sky: Sky
    size: int
    resolution: Resolution

    @property
    def radius(self) -> float:
        """The sphere's radius in the picture [pixels]."""
        return 0.5 * MARGIN * self.size

    @cached_property
    def pixels(self) -> tuple[Any, Array, Array]:
        """Of the pixels that the sphere touches: place in the flat picture, angle from the line of sight, and psi."""
        radius = self.radius
        across = np.arange(self.size) + 0.5 - 0.5 * self.size
        x, y = across[None, :] + 0.0 * across[:, None], -across[:, None] + 0.0 * across
        distance = np.hypot(x, y)
        inside = np.flatnonzero(distance.ravel() < radius + 0.5)
        # a pixel on the rim shows the sphere's edge
        sine = np.minimum(distance.ravel()[inside] / radius, np.sin(self.resolution.theta[-1]))
        return inside, np.arcsin(sine), np.arctan2(y, x).ravel()[inside]

    @cached_property
    def cover(self) -> Array:
        """The share (size, size) of each pixel that the sphere covers."""
        across = np.arange(self.size) + 0.5 - 0.5 * self.size
        return np.clip(self.radius - np.hypot(across, across[:, None]) + 0.5, 0.0, 1.0)

    @cached_property
    def lit(self) -> tuple[Any, Any, Array, Array]:
        """Of the pixels that the sun reaches: which they are, the matrix to the BRDF's table, mu_i and mu_o."""
        _, theta, psi = self.pixels
        normal, x = compute_normals(self.camera, theta, psi)
        mu_i = -(normal @ self.sky.beam)
        lit = np.flatnonzero(mu_i > 0.0)
        cosine, azimuth, _ = convert_to_polar(self.sky.beam, x[lit], np.cross(normal[lit], x[lit]), normal[lit])
        points = np.arccos(-cosine), theta[lit], -azimuth % (2.0 * np.pi)
        matrix = make_spline_matrix((self.resolution.theta, self.resolution.theta, self.resolution.turn), points)
        return lit, matrix, mu_i[lit], np.cos(theta[lit])

    @cached_property
    def gloss(self) -> Gloss:
        """Light that smooth surfaces mirror into the pixels."""
        return Gloss.of(self)

    @cached_property
    def rough(self) -> dict[RoughSurface, RoughGloss]:
        """The last rough surface, and what it mirrors."""
        return {}

    @cached_property
    def rings(self) -> "list[Ring]":
        """The normals for the sky's part: a ring for each outgoing angle of the table."""
        return [Ring.at(self, float(theta)) for theta in self.resolution.theta]

    @cached_property
    def to_pixels(self) -> Any:
        """The matrix from spline coefficients on all rings to the pixels."""
        _, theta, psi = self.pixels
        return make_spline_matrix(
            (self.resolution.theta, make_steps_around(self.resolution.around)[0]), (theta, psi % (2.0 * np.pi))
        )

    def stokes(self, table: Table, place: int) -> Array:
        """Stokes radiance (pixel, 4) to the camera at the wavelength ``place``, of a material with this table."""
        _, _, psi = self.pixels
        found = self.from_the_sky(table, place)
        lit, matrix, mu_i, mu_o = self.lit
        column = np.ascontiguousarray(table.splines.reshape(-1, 4, 4)[:, :, 0])
        strength = self.sky.sun[place] * mu_i * table.slab(np.maximum(mu_i, STEEPEST), mu_o)
        sunlight = (matrix @ column) * strength[:, None]
        found[lit] += turn_stokes(sunlight, psi[lit] - 0.5 * np.pi)
        if table.specular is not None:
            found += self.gloss.stokes(table.specular, self.sky, place)
        if table.facets is not None:
            if table.facets not in self.rough:
                self.rough.clear()  # one takes some hundred megabytes
                self.rough[table.facets] = RoughGloss.of(self, table.facets)
            found += self.rough[table.facets].stokes(self, place)
        return found

    def from_the_sky(self, table: Table, place: int) -> Array:
        """The sky's part of it: (pixel, 4)."""
        values = np.zeros((len(self.rings), self.resolution.around, 4))
        if self.sky.splines[place].any() or self.sky.ground[place]:
            on_rings = compute_ring_splines(table)
            for ring, here in enumerate(self.rings):
                slab = table.slab(here.mu_i, self.resolution.mu[ring])
                values[ring] = here.stokes(on_rings[ring], slab, self.sky, place)
        grid, places = make_steps_around(self.resolution.around)
        smooth = compute_coefficients((self.resolution.theta, grid), values[:, places])
        found: Array = self.to_pixels @ smooth.reshape(-1, 4)
        return found


def compute_ring_splines(table: Table) -> Array:
    """The splines at their own outgoing angles, where the rings are: (theta_o, theta_i, phi, 16)."""
    theta = table.resolution.theta
    back = make_spline_matrix((theta,), (theta,)).toarray()
    return np.ascontiguousarray(np.einsum("no,iopc->nipc", back, table.splines, optimize=True))


@dataclass(frozen=True, eq=False)
class Ring:
    """The normals at one angle from the line of sight, and the directions that light falls on them from.

    Directions (n,) of all normals follow each other. ``to_table``: matrix to the BRDF's spline coefficients at this
    outgoing angle; ``above``: to the sky's; ``azimuth`` [rad] in the world; ``facet``: turn of Stokes axes from sky to
    surface; ``weights`` of the quadrature times mu_i; ``mu_i``, none below STEEPEST; ``from_sky``: whether it is sky
    that is there, or ground. ``psi`` (normal,) is where the normals are.
    """

    psi: Array
    to_table: Any
    above: Any
    azimuth: Array
    facet: Array
    weights: Array
    mu_i: Array
    from_sky: Any

    @classmethod
    def at(cls, view: View, theta: float) -> "Ring":
        resolution = view.resolution
        psi = np.linspace(0.0, 2.0 * np.pi, resolution.around, endpoint=False)
        normal, x = compute_normals(view.camera, np.full(psi.shape, theta), psi)
        travel, weights, from_sky = find_incoming_directions(normal, resolution, ground=bool(view.sky.ground.any()))
        n_each = travel.shape[1]
        normal, x = (np.repeat(part, n_each, axis=0) for part in (normal, x))
        travel, weights, from_sky = travel.reshape(-1, 3), weights.ravel(), from_sky.ravel()
        cosine, azimuth, on_facet = convert_to_polar(travel, x, np.cross(normal, x), normal)
        height, heading, in_world = convert_to_polar(travel, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), UP)
        points = np.arccos(-cosine), -azimuth % (2.0 * np.pi)
        return cls(
            psi,
            make_spline_matrix((resolution.theta, resolution.turn), points),
            make_spline_matrix((view.sky.theta,), (np.arccos(-height[from_sky]),)),
            heading,
            find_turn(travel, in_world, on_facet),
            weights * -cosine,
            np.maximum(-cosine, STEEPEST),
            from_sky,
        )

    def stokes(self, splines: Array, slab: Array, sky: Sky, place: int) -> Array:
        """Stokes radiance (normal, 4) to the camera, from a table's splines (theta_i, phi, 16) at this angle, and its
        factor ``slab`` (n,)."""
        falls_in = np.zeros((self.azimuth.size, 4))
        falls_in[self.from_sky] = sky.stokes(place, self.above, self.azimuth[self.from_sky])
        falls_in[~self.from_sky, 0] = sky.ground[place]
        falls_in = turn_stokes(falls_in, self.facet) * (self.weights * slab)[:, None]
        matrices = (self.to_table @ splines.reshape(-1, 16)).reshape(-1, 4, 4)
        leaves = (matrices @ falls_in[:, :, None]).reshape(self.psi.size, -1, 4).sum(axis=1)
        return turn_stokes(leaves, self.psi - 0.5 * np.pi)


def find_incoming_directions(normal: Array, resolution: Resolution, ground: bool) -> tuple[Array, Array, Any]:
    """Directions of travel (normal, n, 3) of light from above the tangent planes, weights (normal, n) [sr], and which
    come from the sky, not from the ground.

    Tangent plane and horizon cut the sphere of directions into lunes, which share the axis where both planes meet.
    Gauss quadrature takes each lune by itself, from pole to pole and across: no edge of the sky lies within one.
    """
    axis, across, tilt = _find_lune_frame(normal)
    quarter = 0.5 * np.pi
    lunes = [(tilt - quarter, np.full_like(tilt, quarter), True)]
    if ground:
        lunes.append((np.full_like(tilt, -quarter), tilt - quarter, False))
    pole, pole_weights = _find_gauss_nodes(np.zeros(1), np.full(1, np.pi), resolution.along)
    parts = []
    for low, high, from_sky in lunes:
        around, around_weights = _find_gauss_nodes(low, high, resolution.across)  # (normal, across)
        equator = np.cos(around)[..., None] * normal[:, None] + np.sin(around)[..., None] * across[:, None]
        toward = (
            np.sin(pole[0])[:, None, None] * equator[:, None] + np.cos(pole[0])[:, None, None] * axis[:, None, None]
        )
        weights = (np.sin(pole[0]) * pole_weights[0])[:, None] * around_weights[:, None, :]
        parts.append((-toward.reshape(len(normal), -1, 3), weights.reshape(len(normal), -1), from_sky))
    travel, weights = (np.concatenate([part[which] for part in parts], axis=1) for which in (0, 1))
    above = np.concatenate([np.full(part[1].shape, part[2]) for part in parts], axis=1)
    return travel, weights, above


def _find_lune_frame(normal: Array) -> tuple[Array, Array, Array]:
    """The line (normal, 3) where tangent plane and horizon meet, the direction across it in the tangent plane that
    leads to the zenith, and the angle (normal,) from the normal to the zenith; any line where they coincide."""
    axis = np.cross(normal, UP)
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    level = length < 1e-9
    axis = np.where(level, np.array([0.0, -1.0, 0.0]), axis / np.where(level, 1.0, length))
    across = np.cross(axis, normal)
    return axis, across, np.arctan2(across @ UP, normal @ UP)


def _find_gauss_nodes(low: Array, high: Array, count: int) -> tuple[Array, Array]:
    """Gauss nodes and weights (n, count) between low and high (n,)."""
    points, weights = np.polynomial.legendre.leggauss(count)
    half = 0.5 * (high - low)[:, None]
    return (0.5 * (high + low))[:, None] + half * points, half * weights


def compute_irradiance(sky: Sky, normal: Array, resolution: Resolution = Resolution()) -> Array:
    """Irradiance (wavelength, n) [W m-2] on surfaces with these normals (n, 3), sun included.

    >>> from vrte.render.sky import make_sky
    >>> compute_irradiance(make_sky("uniform", [0.5], 30.0, 0.0), np.array([[0.0, 0.6, 0.8]])).round(6).tolist()
    [[3.141593]]
    """
    travel, weights, from_sky = find_incoming_directions(normal, resolution, ground=True)
    heading = np.arctan2(travel[..., 1], travel[..., 0])[from_sky]
    above = make_spline_matrix((sky.theta,), (np.arccos(-travel[..., 2][from_sky]),))
    weights = weights * -np.einsum("nkc,nc->nk", travel, normal)
    found = np.zeros((sky.sun.size, len(normal)))
    for place in range(sky.sun.size):
        seen = np.full(weights.shape, sky.ground[place])
        seen[from_sky] = sky.stokes(place, above, heading)[:, 0]
        found[place] = (weights * seen).sum(axis=1) + sky.sun[place] * np.maximum(-normal @ sky.beam, 0.0)
    return found
