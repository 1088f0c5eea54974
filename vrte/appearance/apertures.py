"""Receptors with finite apertures around the mirror direction, and what rough surfaces send into them.

Light falls in at an angle t in the plane x, z and would be mirrored along a = (sin t, 0, cos t), the axis of the
receptor. With e_1 = (cos t, 0, -sin t), e_2 = (0, 1, 0) a direction of the receptor is d = x e_1 + y e_2 + z a. A
source's extent is given by its mirror image: the same three numbers, so that a smooth surface images one on the other.

    share = (1/S) int_source dOmega int_receptor f(-d', d) (d . n) dOmega,    S = int_source dOmega

Lobes are 2 alpha wide in the plane of incidence and 2 alpha cos t across it. Quadrature is Gauss's on panels that begin
with half of that on either side of the mirrored beam and double: a Gaussian falls as fast as panels grow, and the poles
of GGX's tails at i alpha are as far from each panel as it is long, so that errors fall exponentially with the points.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from vrte.basics.arrays import Array, check_cosines, check_number, check_whole
from vrte.basics.errors import SceneError
from vrte.basics.quadrature import make_double_gauss
from vrte.optics.facet_energy import restore_lost
from vrte.scene.interface import Interface

POINTS, MOST_POINTS = 8, 64  # of a panel; half as many of what has no peak
SOURCE_POINTS = 4  # of half a source, either way: it is smaller than its receptor, and 3e-6 of a share is left out
AXIS, EVEN = np.array([0.0, 0.0, 1.0]), (math.inf, math.inf)  # of a receptor; widths of light that has no peak
WIDEST = 170.0  # [deg], of a rectangle


@dataclass(frozen=True)
class Rectangular:
    """A rectangular stop in the focal plane of a lens, by the full angles [deg], at most 170, that it opens in the
    plane of incidence and across; it is 2 tan(angle/2) focal lengths wide (ASTM D523, from memory)."""

    in_plane_deg: float
    across_deg: float

    def __post_init__(self) -> None:
        for name in ("in_plane_deg", "across_deg"):
            object.__setattr__(self, name, check_angle(f"aperture: {name}", getattr(self, name), WIDEST))

    @property
    def reach_deg(self) -> float:
        """The angle [deg] from the axis to the edge in the plane of incidence."""
        return 0.5 * self.in_plane_deg

    @property
    def half(self) -> Array:
        """Half of the sides over the focal length (2,)."""
        return np.tan(0.5 * np.radians([self.in_plane_deg, self.across_deg]))

    def aim(self, s: Array, t: Array) -> tuple[Array, Array]:
        """Directions (x, y, z) (..., 3) at s, t from -1 to 1, and the solid angle dOmega/(ds dt) there."""
        (x, y), (broad, high) = (s * self.half[0], t * self.half[1]), self.half
        size = np.sqrt(1.0 + x**2 + y**2)
        return np.stack([x, y, np.ones_like(x)], -1) / size[..., None], broad * high / size**3

    def locate(self, direction: Array) -> tuple[float, float]:
        """The coordinates s, t of a direction (3,), beyond -1 and 1 outside."""
        s, t = direction[:2] / direction[2] / self.half
        return float(s), float(t)

    def scale(self, width: float, height: float) -> tuple[float, float]:
        """Angles [rad] near the axis as s and t."""
        return width / self.half[0], height / self.half[1]


@dataclass(frozen=True)
class Round:
    """A round receptor, the port of a sphere or a stop, by the full angle [deg] of its diameter, at most 180."""

    diameter_deg: float

    def __post_init__(self) -> None:
        diameter = check_angle("aperture: diameter_deg", self.diameter_deg, 180.0)
        object.__setattr__(self, "diameter_deg", diameter)

    @property
    def reach_deg(self) -> float:
        """The angle [deg] from the axis to the edge."""
        return 0.5 * self.diameter_deg

    @property
    def radius(self) -> float:
        """Radius of the stereographic image, tan of a quarter of the angle: smooth up to a hemisphere."""
        return math.tan(0.5 * math.radians(self.reach_deg))

    def aim(self, s: Array, t: Array) -> tuple[Array, Array]:
        """Directions (x, y, z) (..., 3) at s, t from -1 to 1, and the solid angle dOmega/(ds dt) there."""
        turned, r = 0.5 * np.pi * s, self.radius
        x, y = r * np.sin(turned), r * np.cos(turned) * t
        size = 1.0 + x**2 + y**2
        direction = np.stack([2.0 * x, 2.0 * y, 2.0 - size], -1) / size[..., None]
        return direction, 2.0 * np.pi * (r * np.cos(turned) / size) ** 2

    def locate(self, direction: Array) -> tuple[float, float]:
        """The coordinates s, t of a direction (3,), clipped to where there are any."""
        x, y = direction[:2] / (1.0 + direction[2]) / self.radius
        chord = math.sqrt(max(1.0 - float(x) ** 2, 1e-12))
        return 2.0 / math.pi * math.asin(min(max(float(x), -1.0), 1.0)), float(y) / chord

    def scale(self, width: float, height: float) -> tuple[float, float]:
        """Angles [rad] near the axis as s and t."""
        return width / (math.pi * self.radius), height / (2.0 * self.radius)


Receptor = Rectangular | Round


def check_angle(name: str, value: float, most: float) -> float:
    """A full angle [deg]. Raises SceneError."""
    return check_number(name, value, 1e-3, most, f"an angle from 0.001 to {most:g} degrees")


def check_in_view(receptor: Receptor, angle_deg: float) -> None:
    """Whether all of a receptor is above the surface. Raises SceneError."""
    if angle_deg + receptor.reach_deg > 90.0 + 1e-9:
        words = f"reaches {receptor.reach_deg:g} degrees from its axis at {angle_deg:g}: below the surface's horizon"
        raise SceneError.of("aperture", words)


def project_solid_angle(receptor: Receptor, angle_deg: float) -> float:
    """The integral [sr] of cos(theta) over a receptor whose axis is ``angle_deg`` from the normal: the flux that it
    gets of radiance 1. Raises SceneError where the receptor reaches below the horizon."""
    check_in_view(receptor, angle_deg)
    s, t, weights = make_rule(receptor, AXIS, EVEN, 2 * POINTS)
    direction, density = receptor.aim(s, t)
    return float((weights * density) @ turn_up(direction, math.radians(angle_deg))[:, 2])


def collect_mirrored(
    interface: Interface, mu_i: float, receptor: Receptor, source: Rectangular | None = None, points: int = POINTS
) -> float:
    """The share of an unpolarized beam that a surface by itself sends into a receptor around the mirror direction.

    ``source``: the extent of an evenly bright lamp around the beam; ``points``: Gauss points of a panel, by which
    convergence is shown. A smooth surface sends the whole mirrored beam. Raises SceneError where receptor or source
    reach below the horizon. The lobe is that of `vrte.optics.facets` (Walter et al. 2007).
    """
    angle_deg = math.degrees(math.acos(check_cosines("mu_i", mu_i).item()))
    check_in_view(receptor, angle_deg)
    if source is not None:
        check_in_view(source, angle_deg)
    return integrate_share(interface, angle_deg, receptor, source, check_whole("points", points, 2, MOST_POINTS))


@lru_cache(maxsize=1024)
def integrate_share(
    interface: Interface, angle_deg: float, receptor: Receptor, source: Rectangular | None, points: int
) -> float:
    """The integral of `collect_mirrored`, kept for surfaces that are the same at many wavelengths."""
    angle = math.radians(angle_deg)
    beams = [(AXIS, 1.0)] if source is None else list_beams(source)
    mirrored = [turn_up(beam, angle) for beam, _ in beams]
    if interface.is_smooth:
        shares = interface.share([min(float(up[2]), 1.0) for up in mirrored])[0]
        return float(shares @ [weight for _, weight in beams])
    once = replace(interface.facets, conserving=False)
    widths = receptor.scale(interface.roughness, interface.roughness * math.cos(angle))  # half of a lobe's
    found = 0.0
    for (beam, weight), up in zip(beams, mirrored, strict=True):
        s, t, weights = make_rule(receptor, beam, widths, points)
        direction, density = receptor.aim(s, t)
        out = turn_up(direction, angle)
        mu_o = np.clip(out[:, 2], 1e-9, 1.0)
        azimuth = np.degrees(np.arctan2(out[:, 1], out[:, 0]) - math.atan2(up[1], up[0]))
        f = once.reflect(min(float(up[2]), 1.0), mu_o, azimuth)[:, 0, 0]
        found += weight * float((weights * density * mu_o) @ f)
    if interface.conserving:  # even but for the cosines, and slow
        s, t, weights = make_rule(receptor, AXIS, EVEN, points // 2)
        direction, density = receptor.aim(s, t)
        mu_o = np.clip(turn_up(direction, angle)[:, 2].round(12), 1e-9, 1.0)  # alike on both sides
        restored = restore_lost(interface.facets, np.array(math.cos(angle)), mu_o, False)[:, 0, 0]
        found += float((weights * density * mu_o) @ restored)
    return float(found)


def list_beams(source: Rectangular) -> list[tuple[Array, float]]:
    """Directions (3,) of an evenly bright source and their shares of its light; of two equal halves the first."""
    s, t, weights = make_rule(source, AXIS, EVEN, SOURCE_POINTS)
    directions, density = source.aim(s, t)
    half = t > 0.0
    shares = (weights * density)[half]
    return list(zip(directions[half], shares / shares.sum(), strict=True))


def turn_up(direction: Array, angle: float) -> Array:
    """From the receptor's axes to those of the surface, (..., 3): x along the light's travel, z up."""
    sine, cosine = math.sin(angle), math.cos(angle)
    x, y, z = np.moveaxis(direction, -1, 0)
    return np.stack([cosine * x + sine * z, y, cosine * z - sine * x], -1)


def make_rule(receptor: Receptor, peak: Array, widths: tuple[float, float], points: int) -> tuple[Array, Array, Array]:
    """Points s, t and weights (n,) of a quadrature over a receptor for light that peaks along a direction (3,)."""
    pairs = zip(receptor.locate(peak), widths, strict=True)
    (s, share_s), (t, share_t) = (place_points(index, width, points) for index, width in pairs)
    grid_s, grid_t = np.meshgrid(s, t, indexing="ij")
    return grid_s.ravel(), grid_t.ravel(), np.outer(share_s, share_t).ravel()


def place_points(peak: float, width: float, points: int) -> tuple[Array, Array]:
    """Points and weights on [-1, 1] of Gauss's rule on panels that begin so wide on both sides of a peak and double."""
    peak = min(max(peak, -1.0), 1.0)
    steps = width * 2.0 ** np.arange(max(0, math.ceil(math.log2(2.0 / width))) + 1) if width < 2.0 else np.empty(0)
    edges = np.concatenate([[-1.0, 1.0, peak], peak - steps, peak + steps])
    edges = np.unique(edges[np.abs(edges) <= 1.0])
    x, weights = make_double_gauss(points)
    size = np.diff(edges)[:, None]
    return (edges[:-1, None] + size * x).ravel(), (size * weights).ravel()
