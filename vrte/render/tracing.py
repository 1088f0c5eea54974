"""Objects on the ground, traced by Mitsuba: light from object to object and back to the ground counts, too.

One wavelength at a time, in the variant llvm_ad_mono_polarized, with the light of sky.py and the BRDFs of the materials
as `vrte.mitsuba` samples them. Mitsuba's first Stokes axis is the picture's horizontal x, its second k x x: against
ours, upright l and r x l = k, Q changes its sign.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.llvm import prepare_llvm
from vrte.basics.splines import make_spline_matrix
from vrte.exports.half_vectors import STEEPEST
from vrte.formats.atomic import check_file
from vrte.render.geometry import Body, Lens
from vrte.render.objects import SUN_DISC, SUN_RADIUS
from vrte.render.sky import LUMINANCE, Film, Sky

VARIANT = "llvm_ad_mono_polarized"
HEIGHTS = 256  # of the sky's table, even in the root of the cosine from the zenith
FAR = 1e4  # radius of the ground, in sizes of an object
DEEPEST = 64  # scatterings that a path is followed through
SAMPLES, MOST_SAMPLES = 32, 65536  # paths of a pixel and wavelength
ACROSS = np.array([1.0, -1.0, -1.0, 1.0])  # of Stokes vectors between the plane of incidence and the axis across it
SUN_SHARES = 0.2, 0.9  # of the samples of light, at least and at most, where there is a sky beside the sun
CHORD = 2.0 * np.sin(0.5 * SUN_RADIUS)  # of the sun's disc, from its middle to its rim


def tabulate_sky(sky: Sky) -> Array:
    """Fourier orders 0 to 2 of I, Q and U (height, order, 3) at even roots of the cosine from the zenith, of the sky at
    one wavelength."""
    cosine = np.linspace(0.0, 1.0, HEIGHTS) ** 2
    orders = make_spline_matrix((sky.theta,), (np.arccos(cosine),)) @ sky.splines[0, ..., :3].reshape(
        sky.theta.size, -1
    )
    return np.asarray(orders).reshape(HEIGHTS, 3, 3)


@cache
def make_sky_class() -> Any:
    """The emitter of the sun and a polarized sky, in Mitsuba's variant VARIANT."""
    from vrte.mitsuba.bsdf import dr, hold, mi, split, take

    class SkyLight(mi.Emitter):
        """The sun's even disc, unpolarized, and the upper half of the sky. Without ``caustics`` the disc is a place
        that samples of light know and no path meets: what mirrors send of it to other things is left out."""

        def __init__(self, props: Any, sky: Sky, caustics: bool) -> None:
            mi.Emitter.__init__(self, props)
            self.m_flags = +mi.EmitterFlags.Infinite
            self.caustics = caustics
            orders = tabulate_sky(sky)
            self.orders = hold(orders)
            toward = -sky.beam
            self.sun, level = mi.Vector3f(*toward.tolist()), toward[:2] / (np.hypot(*toward[:2]) or 1.0)
            self.level = mi.Vector2f(*level.tolist())  # the way to the sun, on the ground
            self.disc = mi.Float(float(sky.sun[0]) / SUN_DISC)
            root = np.linspace(0.0, 1.0, HEIGHTS)
            even = 4.0 * np.pi * float(np.mean(orders[:, 0, 0] * root**3)), float(sky.sun[0] * toward[2])
            # irradiance by the sky and by the sun: the part of samples that the sun has
            share = float(np.clip(even[1] / sum(even), *SUN_SHARES)) if all(even) else float(even[1] > 0.0)
            self.share, self.rest = mi.Float(share), mi.Float(1.0 - share)
            dr.make_opaque(self.sun, self.level, self.disc, self.share, self.rest)  # one kernel for all wavelengths

        def shine(self, toward: Any, sky: Any, sun: Any) -> Any:
            """The light from a direction, as the first column of a Mueller matrix, where ``sky`` and ``sun`` count."""
            across = dr.sqrt(dr.maximum(toward.x * toward.x + toward.y * toward.y, 1e-12))
            heading = mi.Vector2f(-toward.x / across, -toward.y / across)
            cosine = -dr.dot(heading, self.level)
            sine = heading.x * self.level.y - heading.y * self.level.x
            even, odd = [1.0, cosine, 2.0 * cosine * cosine - 1.0], [0.0, sine, 2.0 * sine * cosine]
            cell, part = split(dr.sqrt(dr.clip(toward.z, 0.0, 1.0)), HEIGHTS)
            stokes = []
            for parameter, waves in enumerate((even, even, odd)):
                total = mi.Float(0.0)
                for order, wave in enumerate(waves):
                    low, high = (
                        take(mi.Float, self.orders, 9 * (cell + step) + 3 * order + parameter) for step in (0, 1)
                    )
                    total += (low + part * (high - low)) * wave
                stokes.append(dr.select(sky & (toward.z > 0.0), total, 0.0))
            value = mi.Spectrum(0.0)
            value[0, 0] = mi.UnpolarizedSpectrum(stokes[0])
            value[1, 0], value[2, 0] = mi.UnpolarizedSpectrum(stokes[1]), mi.UnpolarizedSpectrum(-stokes[2])
            travel = -toward
            polar = mi.Vector3f(travel.z * heading.x, travel.z * heading.y, -across)
            value = mi.mueller.rotate_stokes_basis(travel, polar, mi.mueller.stokes_basis(travel)) @ value
            value[0, 0] += mi.UnpolarizedSpectrum(dr.select(sun, self.disc, 0.0))
            return value

        def meet(self, toward: Any) -> Any:
            """The light from a direction that a path takes."""
            return self.shine(toward, mi.Bool(True), self.is_met(toward))

        def is_met(self, toward: Any) -> Any:
            """Whether a path in this direction meets the sun's disc."""
            return mi.Bool(self.caustics) & (dr.squared_norm(toward - self.sun) < CHORD**2)

        def find_density(self, toward: Any) -> Any:
            """The density of sampled directions that a path may take, too [1/sr]."""
            sky = dr.select(toward.z > 0.0, self.rest / (2.0 * dr.pi), 0.0)
            return sky + dr.select(self.is_met(toward), self.share / SUN_DISC, 0.0)

        def sample_direction(self, it: Any, sample: Any, active: Any = True) -> Any:
            """A direction of the sun or the sky, and its light over its density."""
            chosen = sample.x < self.share
            first = dr.select(
                chosen, sample.x / dr.maximum(self.share, 1e-9), (sample.x - self.share) / dr.maximum(self.rest, 1e-9)
            )
            on_disc = mi.warp.square_to_uniform_disk(mi.Point2f(first, sample.y)) * float(np.sin(SUN_RADIUS))
            near = dr.normalize(self.sun + mi.Frame3f(self.sun).to_world(mi.Vector3f(on_disc.x, on_disc.y, 0.0)))
            above = mi.warp.square_to_uniform_hemisphere(mi.Point2f(first, sample.y))
            found = dr.zeros(mi.DirectionSample3f)
            found.d = dr.select(chosen, near, above)
            found.dist = 4.0 * FAR
            found.p = it.p + found.d * found.dist
            found.n = -found.d
            found.time = it.time
            found.delta = chosen & (not self.caustics)
            found.pdf = dr.select(found.delta, self.share / SUN_DISC, self.find_density(found.d))
            found.emitter = mi.EmitterPtr(self)
            light = self.shine(found.d, ~found.delta, found.delta | self.is_met(found.d))
            return found, dr.select(found.pdf > 0.0, light / dr.maximum(found.pdf, 1e-9), mi.Spectrum(0.0))

        def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            """The density of `sample_direction`."""
            return self.find_density(ds.d)

        def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            """The light along a direction sample."""
            return self.meet(ds.d)

        def eval(self, si: Any, active: Any = True) -> Any:
            """The light that a ray meets which meets nothing else."""
            return self.meet(-si.wi)

        def bbox(self) -> Any:
            """An empty box: the sky has no place in space."""
            return mi.ScalarBoundingBox3f()

        def to_string(self) -> str:
            return "SkyLight[]"

    return SkyLight


def make_mesh(body: Body) -> Any:
    """A body as Mitsuba's mesh."""
    from vrte.mitsuba.bsdf import mi

    mesh = mi.Mesh("body", len(body.corners), len(body.triangles), has_vertex_normals=True)
    fields = mi.traverse(mesh)
    fields["vertex_positions"] = np.float32(body.corners).ravel()
    fields["vertex_normals"] = np.float32(body.normals).ravel()
    fields["faces"] = np.uint32(body.triangles).ravel()
    fields.update()
    return mesh


def is_ready() -> bool:
    """Whether Mitsuba is installed, and an LLVM that it works with."""
    return find_spec("mitsuba") is not None and prepare_llvm()


@dataclass(frozen=True)
class Tracing:
    """How pictures are traced: ``samples``, paths of a pixel and wavelength; ``environment``, an image (.exr, .hdr) of
    the light from all sides in place of sky and ground, linear sRGB, its upper edge the zenith; whether ``caustics``
    count, the sun's light that smooth surfaces mirror onto other things."""

    samples: int = SAMPLES
    environment: Path | None = None
    caustics: bool = False

    def make_light(self, sky: Sky, film: Film, observer: Array, at: int) -> Any:
        """Mitsuba's emitter at one of the wavelengths of ``observer`` (3, wavelength), of which ``sky`` has one."""
        from vrte.mitsuba.bsdf import mi

        if self.environment is None:
            return make_sky_class()(mi.Properties(), sky, self.caustics)
        radiance = np.maximum(read_environment(self.environment) @ spread_colours(film, observer)[:, at], 0.0)
        image = mi.Bitmap(np.float32(np.repeat(radiance[..., None], 3, axis=2)))
        upright = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
        return {"type": "envmap", "bitmap": image, "to_world": upright}


@cache
def read_environment(path: Path) -> Array:
    """Linear sRGB (height, width, 3) of an image. Raises SceneError."""
    from vrte.mitsuba.bsdf import mi

    try:
        image = mi.Bitmap(str(check_file(path)))
        image = image.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    except RuntimeError as error:
        raise SceneError(f"{path}: not an image that Mitsuba reads: {str(error).splitlines()[0][:120]}") from error
    found = np.array(image)
    if not np.isfinite(found).all() or not found.any():
        raise SceneError(f"{path}: must have finite radiances, and some light")
    return found


def spread_colours(film: Film, observer: Array) -> Array:
    """The smoothest spectra (3, wavelength) of the colours red, green and blue on a film, by least squares of second
    differences: white is 1 at all wavelengths. Of fewer than 4 wavelengths, all have the luminance."""
    count = observer.shape[1]
    if count < 4:
        return np.outer(LUMINANCE, np.ones(count))
    seen = film.linear(observer.T).T
    bend = np.diff(np.eye(count), 2, axis=0)
    system = np.block([[bend.T @ bend, seen.T], [seen, np.zeros((3, 3))]])
    return np.linalg.solve(system, np.concatenate([np.zeros((count, 3)), np.eye(3)]))[:count].T


def mirror_beam(beam: Any, mu: Array) -> Array:
    """The fraction (n, 4, 4) of light along mu (n,) that is mirrored as a beam, in the surface's axes l and r, by the
    ``beam`` (theta, 4, 4) of a `HalfVectorTable` at one wavelength."""
    x = np.arcsin(np.minimum(np.arccos(mu) / STEEPEST, 1.0)) * (2.0 / np.pi) * (len(beam) - 1)
    cell = np.minimum(x.astype(int), len(beam) - 2)
    part = (x - cell)[:, None, None]
    return ((1.0 - part) * beam[cell] + part * beam[cell + 1]) * np.outer(ACROSS, ACROSS)


class Scene:
    """What Mitsuba traces: ``bodies`` before a ``lens``, ``albedo`` of the ground, None without one."""

    def __init__(self, bodies: Sequence[Body], lens: Lens, albedo: float | None) -> None:
        from vrte.mitsuba.bsdf import mi

        film = {"type": "hdrfilm", "width": lens.width, "height": lens.height, "rfilter": {"type": "box"}}
        film |= {"pixel_format": "luminance", "component_format": "float32"}
        at, to, up = (part.tolist() for part in (lens.place, lens.middle, lens.camera.up))
        sensor = {
            "type": "perspective",
            "fov": float(np.degrees(2.0 * np.arctan(lens.spread))),
            "fov_axis": "y",
            "near_clip": 1e-3,
            "far_clip": 10.0 * FAR,
            "to_world": mi.ScalarTransform4f().look_at(origin=at, target=to, up=up),
            "film": film,
        }
        integrator = {"type": "stokes", "nested": {"type": "path", "max_depth": DEEPEST}}
        self.known: dict[str, Any] = {"type": "scene", "integrator": integrator, "sensor": sensor}
        if albedo is not None:
            ground = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [albedo] * 3}}
            self.known["ground"] = {"type": "disk", "to_world": mi.ScalarTransform4f().scale(FAR), "bsdf": ground}
        self.meshes = [make_mesh(body) for body in bodies]

    def trace(self, bsdfs: Sequence[Any], light: Any, samples: int, seeds: Sequence[int]) -> Array:
        """Stokes radiance (seed, height, width, 4) at one wavelength, from ``samples`` paths a pixel and seed, with the
        BSDF of each body."""
        from vrte.mitsuba.bsdf import mi

        for mesh, bsdf in zip(self.meshes, bsdfs, strict=True):
            mesh.set_bsdf(bsdf)
        scene = mi.load_dict(self.known | {"light": light} | {f"body{k}": mesh for k, mesh in enumerate(self.meshes)})
        found = np.stack([np.array(mi.render(scene, spp=samples, seed=seed)) for seed in seeds])
        return found[..., 1::3] * [1.0, -1.0, 1.0, 1.0]
