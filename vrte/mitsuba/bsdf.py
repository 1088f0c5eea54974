"""The BSDF `vrte` of Mitsuba 3, which reads results in NetCDF.

``{"type": "vrte", "filename": "paint.nc"}`` is what `vrte export paint.toml -o paint.nc` wrote: Mueller matrices at any
wavelengths, a mirrored beam, and directions sampled in proportion to BRDF times cosine. The table is that of
exports/half_vectors.py; between wavelengths it is linear, beyond them constant. Variants without wavelengths get linear
sRGB in which a perfect white diffuser in D65 is 1. docs/how_to/exports.md.
"""

import itertools
from functools import cache
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError, import_extra
from vrte.basics.llvm import NAMED, OLDEST
from vrte.exports.colour import weigh_channels
from vrte.exports.half_vectors import FACETS, LOWEST, STEEPEST, HalfVectorTable, check_directions, tabulate_half_vectors
from vrte.formats.result_file import load
from vrte.optics.facets import RoughSurface
from vrte.results.brdf import Brdf, Spectrum

mi = import_extra("mitsuba", "vrte.mitsuba", "mitsuba")
dr = import_extra("drjit", "vrte.mitsuba", "mitsuba")
REGISTERED: dict[str, Any] = {}  # the class of the BSDF by Mitsuba's variants
FEW = 8  # wavelengths of a table, all of which are read at once for those that are traced together: 4, two each
LUMINANCE = np.array([[0.2126, 0.7152, 0.0722]])  # of linear sRGB


def read_table(path: str, polarized: bool) -> HalfVectorTable:
    """The table of a result's file. Raises SceneError, OSError, MissingExtraError."""
    found = load(path)
    if isinstance(found, Brdf):
        found = Spectrum(np.array([0.55]), (found,))
    if not isinstance(found, Spectrum):
        raise SceneError(f"{path}: must hold a BRDF, not a {type(found).__name__}")
    try:
        check_directions(found[0])
        return tabulate_half_vectors(found, [read_facets(one) for one in found], polarized)
    except SceneError as error:
        raise error.behind(path) from error


def read_facets(one: Brdf) -> RoughSurface | None:
    """The rough surface on top, as `vrte export` noted it. Raises SceneError where nothing is noted."""
    noted = one.diagnostics.get(FACETS)
    if noted is None and one.surface is not None:
        raise SceneError("what a rough surface reflects is in the result on its grid alone: write it by `vrte export`")
    return RoughSurface(**noted | {"index": complex(*noted["index"])}) if noted else None


def weigh_colours(wavelength_um: Array) -> Array:
    """Weights (channel, wavelength) of linear sRGB, or of luminance; a table without wavelengths has linear sRGB.
    Raises SceneError, MissingExtraError."""
    if wavelength_um.size > 1:
        weights = weigh_channels(wavelength_um)
    else:
        weights = np.ones((3, 1)) if wavelength_um.size else np.eye(3)
    return weights if mi.is_rgb else LUMINANCE @ weights


def check_llvm() -> None:
    """Raises ImportError where an older LLVM, found before ours was named, would end the process."""
    version = dr.detail.llvm_version()
    if mi.variant().startswith("llvm") and 0 < version[0] < OLDEST:
        raise ImportError(
            f"Mitsuba has loaded LLVM {'.'.join(map(str, version))}, with which {mi.variant()} ends the process: "
            f"import vrte.mitsuba before mitsuba, or let {NAMED} name the library of LLVM {OLDEST} or newer"
        )


def register() -> None:
    """Registers the BSDF for the variant of Mitsuba that is set. Raises ImportError."""
    check_llvm()

    class VrteBsdf(mi.BSDF):  # type: ignore[name-defined]
        """A tabulated BRDF (component 0), and a mirrored beam (component 1) where there is one."""

        def __init__(self, props: Any, table: HalfVectorTable | None = None) -> None:
            mi.BSDF.__init__(self, props)
            self.path = "" if table else str(mi.file_resolver().resolve(props["filename"]))
            table = table or read_table(self.path, mi.is_polarized)
            values: Any = table.values
            beam: Any = table.beam
            density = table.density
            self.nanometres = 1e3 * table.wavelength_um
            if not mi.is_spectral:
                weights = weigh_colours(table.wavelength_um)
                values, beam = (
                    None if part is None else np.einsum("cw,...wij->...cij", weights, part) for part in (values, beam)
                )
            self.values, self.values_shape = hold(values), values.shape
            grid = np.linspace(0.0, 1.0, len(density))
            positive = np.maximum(density, 0.0)
            positive[~positive.any(axis=(1, 2))] = 1.0  # nothing comes back but a beam: any direction will do
            self.directions = mi.MarginalContinuous2D1(np.float32(positive), [np.float32(grid)])
            self.m_components = [mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide]
            self.chance = None
            if beam is not None:
                self.m_components += [mi.BSDFFlags.DeltaReflection | mi.BSDFFlags.FrontSide]
                self.beam, self.beam_shape = hold(beam), beam.shape
                cells = (density.shape[1] - 1) * (density.shape[2] - 1)
                ends = np.outer(*(np.append(0.5, np.append(np.ones(n - 2), 0.5)) for n in density.shape[1:]))
                diffuse = np.interp(np.linspace(0.0, 1.0, len(beam)), grid, (density * ends).sum(axis=(1, 2)) / cells)
                mirrored = beam[..., 0, 0].mean(axis=1)
                self.chance = hold(mirrored / np.maximum(mirrored + diffuse, 1e-12))
            self.m_flags = self.m_components[0] | self.m_components[-1]

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            """A direction, its density, and BRDF times cosine over density."""
            x, along, mu = self.look(si.wi)
            active = active & (mu > 0.0)
            chance = self.find_chance(ctx, x)
            mirrored, diffuse = sample1 < chance, sample1 >= chance
            side = dr.select(sample2.y < 0.5, 1.0, -1.0)
            folded = dr.select(sample2.y < 0.5, 2.0 * sample2.y, 2.0 * sample2.y - 1.0)
            (s, t), _ = self.directions.sample(mi.Point2f(sample2.x, folded), [x], active)
            theta_m = find_last(si.wi, dr.cos(dr.pi * t)) * dr.square(dr.sin(0.5 * dr.pi * s))
            sine, azimuth = dr.sin(theta_m), side * dr.pi * t
            ahead, beside = sine * dr.cos(azimuth), sine * dr.sin(azimuth)
            half = mi.Vector3f(ahead * along.x - beside * along.y, ahead * along.y + beside * along.x, dr.cos(theta_m))
            half = dr.select(mirrored, mi.Vector3f(0.0, 0.0, 1.0), half)
            bs = dr.zeros(mi.BSDFSample3f)
            bs.wo = mi.reflect(si.wi, half)
            bs.eta = 1.0
            delta, glossy = (mi.UInt32(+kind) for kind in (mi.BSDFFlags.DeltaReflection, mi.BSDFFlags.GlossyReflection))
            bs.sampled_type = dr.select(mirrored, delta, glossy)
            bs.sampled_component = dr.select(mirrored, mi.UInt32(1), mi.UInt32(0))
            bs.pdf = dr.select(mirrored, chance, self.pdf(ctx, si, bs.wo, active & diffuse))
            active = active & (bs.pdf > 0.0) & (bs.wo.z > 0.0)
            value = self.eval(ctx, si, bs.wo, active & diffuse)
            if self.chance is not None:
                value = dr.select(mirrored, self.mirror(ctx, si, x, along), value)
            return bs, dr.select(active, value / dr.maximum(bs.pdf, 1e-30), mi.Spectrum(0.0))

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            """BRDF times cosine; Mueller matrices between Mitsuba's Stokes bases."""
            active = active & (si.wi.z > 0.0) & (wo.z > 0.0)
            if not ctx.is_enabled(mi.BSDFFlags.GlossyReflection, 0):
                return mi.Spectrum(0.0)
            light, view = order(ctx, si.wi, wo)
            x, t, s, side = self.find_place(light, view)
            value = self.interpolate(self.values, self.values_shape, (x, t, s), si)
            value = value * (dr.abs(wo.z) / (dr.maximum(light.z, LOWEST) + view.z))
            if mi.is_polarized:
                for row, column in ((0, 2), (0, 3), (1, 2), (1, 3)):  # odd in the azimuth
                    value[row, column] *= side
                    value[column, row] *= side
                across = dr.cross(light, view)
                same = dr.squared_norm(across) < 1e-14
                value = turn(value, light, view, dr.select(same, mi.Vector3f(0.0, 1.0, 0.0), across))
            return dr.select(active, value, mi.Spectrum(0.0))

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            """Density of `sample` per solid angle, without the beam."""
            active = active & (si.wi.z > 0.0) & (wo.z > 0.0)
            if not ctx.is_enabled(mi.BSDFFlags.GlossyReflection, 0):
                return mi.Float(0.0)
            x, t, s, _ = self.find_place(wo, si.wi)
            last = find_last(si.wi, dr.cos(dr.pi * t))
            half = dr.normalize(wo + si.wi)
            theta_m, slope = last * dr.square(dr.sin(0.5 * dr.pi * s)), 0.5 * dr.pi * last * dr.sin(dr.pi * s)
            area = 8.0 * dr.pi * slope * dr.sin(theta_m) * dr.dot(half, si.wi)
            density = self.directions.eval(mi.Point2f(s, t), [x], active) / dr.maximum(area, 1e-20)
            return dr.select(active, (1.0 - self.find_chance(ctx, x)) * density, 0.0)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            """The value and the density of `eval` and `pdf`."""
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def look(self, view: Any) -> tuple[Any, Any, Any]:
            """x of the angle of view, the azimuth as a vector, and the cosine."""
            across = dr.sqrt(view.x * view.x + view.y * view.y)
            there = across > 1e-7
            along = dr.select(there, mi.Vector2f(view.x, view.y) / dr.maximum(across, 1e-7), mi.Vector2f(1.0, 0.0))
            theta = dr.minimum(dr.atan2(across, view.z) / STEEPEST, 1.0)
            return dr.asin(theta) * (2.0 / dr.pi), along, view.z

        def find_place(self, light: Any, view: Any) -> tuple[Any, Any, Any, Any]:
            """x, t and s of the table, and on which side of the view the half vector is."""
            x, along, _ = self.look(view)
            half = light + view
            azimuth = dr.atan2(along.x * half.y - along.y * half.x, along.x * half.x + along.y * half.y)
            theta_m = dr.atan2(dr.sqrt(half.x * half.x + half.y * half.y), half.z)
            part = dr.minimum(theta_m / find_last(view, dr.cos(azimuth)), 1.0)
            s = dr.asin(dr.sqrt(part)) * (2.0 / dr.pi)
            return x, dr.abs(azimuth) / dr.pi, s, dr.select(azimuth < 0.0, -1.0, 1.0)

        def find_chance(self, ctx: Any, x: Any) -> Any:
            """The probability of the beam."""
            diffuse = ctx.is_enabled(mi.BSDFFlags.GlossyReflection, 0)
            if self.chance is None or not ctx.is_enabled(mi.BSDFFlags.DeltaReflection, 1):
                return mi.Float(0.0)
            if not diffuse:
                return mi.Float(1.0)
            cell, part = split(x, self.beam_shape[0])
            return (1.0 - part) * take(mi.Float, self.chance, cell) + part * take(mi.Float, self.chance, cell + 1)

        def mirror(self, ctx: Any, si: Any, x: Any, along: Any) -> Any:
            """The fraction of the beam's power that is mirrored."""
            value = self.interpolate(self.beam, self.beam_shape, (x,), si)
            if not mi.is_polarized:
                return value
            light, view = order(ctx, si.wi, mi.reflect(si.wi))
            return turn(value, light, view, mi.Vector3f(-along.y, along.x, 0.0))

        def interpolate(self, buffer: Any, shape: tuple[int, ...], at: tuple[Any, ...], si: Any) -> Any:
            """Linear interpolation of a table (n, ..., channel, 4, 4) or (..., 1, 1) at ``at``, each from 0 to 1."""
            corners = [(mi.UInt32(0), mi.Float(1.0))]
            for place, count in zip(at, shape, strict=False):
                cell, part = split(place, count)
                corners = [
                    (index * count + cell + step, weight * (part if step else 1.0 - part))
                    for index, weight in corners
                    for step in (0, 1)
                ]
            kind, channels = mi.Matrix4f if mi.is_polarized else mi.Float, shape[len(at)]

            def interpolate_channel(channel: Any) -> Any:
                return sum(take(kind, buffer, index * channels + channel) * weight for index, weight in corners)

            lanes = self.find_lanes(si)
            if all(isinstance(channel, int) for lane in lanes for channel, _ in lane):
                interpolate_channel = cache(interpolate_channel)  # once for all that are traced together
            found = [sum(interpolate_channel(channel) * share for channel, share in lane) for lane in lanes]
            if not mi.is_polarized:
                return mi.Spectrum(found)
            value = mi.Spectrum(0.0)
            for row, column in np.ndindex(4, 4):
                value[row, column] = mi.UnpolarizedSpectrum([lane[row, column] for lane in found])
            return value

        def find_lanes(self, si: Any) -> list[list[tuple[Any, Any]]]:
            """Channels of the table, and their weights, of each wavelength that is traced, or of each colour."""
            size = self.nanometres.size
            if not mi.is_spectral:
                return [[(channel, 1.0)] for channel in range(3 if mi.is_rgb else 1)]
            if size == 1:
                return [[(0, 1.0)] for _ in si.wavelengths]
            lanes, steps = [], list(itertools.pairwise(self.nanometres.tolist()))
            if size <= FEW:
                for wavelength in si.wavelengths:
                    parts = [dr.clip((wavelength - low) / (high - low), 0.0, 1.0) for low, high in steps]
                    shares = [before - after for before, after in itertools.pairwise([1.0, *parts, 0.0])]
                    lanes.append(list(enumerate(shares)))
                return lanes
            for wavelength in si.wavelengths:
                place = sum(dr.clip((wavelength - low) / (high - low), 0.0, 1.0) for low, high in steps)
                cell, part = split(place / (size - 1), size)
                lanes.append([(cell, 1.0 - part), (cell + 1, part)])
            return lanes

        def to_string(self) -> str:
            """The name of the BSDF and its file."""
            return f"vrte[{self.path}]"

    mi.register_bsdf("vrte", VrteBsdf)
    REGISTERED[mi.variant()] = VrteBsdf


def make_bsdf(table: HalfVectorTable) -> Any:
    """The BSDF of a table, in the variant that is set."""
    return REGISTERED[mi.variant()](mi.Properties("vrte"), table)


def hold(values: Any) -> Any:
    """An array in single precision as a flat buffer that `take` reads."""
    flat = np.ascontiguousarray(values, np.float32).ravel()
    return mi.Float(flat) if dr.is_jit_v(mi.Float) else flat


def take(kind: Any, buffer: Any, index: Any) -> Any:
    """An entry of a buffer of numbers, or of matrices."""
    if dr.is_jit_v(mi.Float):
        return dr.gather(kind, buffer, index)
    return kind(buffer[16 * index : 16 * index + 16].reshape(4, 4)) if kind is mi.Matrix4f else float(buffer[index])


def split(place: Any, count: int) -> tuple[Any, Any]:
    """The cell of an even grid of ``count`` points from 0 to 1, and the fraction of the way through it."""
    scaled = place * (count - 1)
    cell = dr.clip(mi.Int32(scaled), 0, count - 2)
    return mi.UInt32(cell), scaled - mi.Float(cell)


def find_last(view: Any, cos_azimuth: Any) -> Any:
    """The angle of half vectors that send light from the horizon to the view."""
    across = dr.sqrt(view.x * view.x + view.y * view.y)
    return 0.25 * dr.pi + 0.5 * dr.atan2(across * cos_azimuth, view.z)


def order(ctx: Any, wi: Any, wo: Any) -> tuple[Any, Any]:
    """The directions of light and view: a Mueller matrix is for light on its real way, also where it is traced back."""
    return (wo, wi) if ctx.mode == mi.TransportMode.Radiance else (wi, wo)


def turn(value: Any, light: Any, view: Any, across: Any) -> Any:
    """Mueller matrices from the axes across the plane of light and view to Mitsuba's Stokes bases."""
    across = dr.normalize(across)
    bases = mi.mueller.stokes_basis(-light), mi.mueller.stokes_basis(view)
    return mi.mueller.rotate_mueller_basis(value, -light, across, bases[0], view, across, bases[1])


def register_again(_: str | None, new: str | None) -> None:
    """Registers the BSDF where another variant is set."""
    if new:
        register()
