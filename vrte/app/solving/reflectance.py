"""Reflectance over two bases, and the colour that this makes: of a paint, its hiding power."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vrte.appearance.colours import convert_to_hex
from vrte.basics.arrays import Array
from vrte.basics.errors import MissingExtraError
from vrte.results.brdf import Brdf
from vrte.scene.boundary import Lambertian
from vrte.scene.scene import Scene

FEWEST, FROM_UM, TO_UM = 5, 0.46, 0.64  # wavelengths that make a colour: so many, from below the one to above the other
IN_FILE = "as in the file"
WITH_BEAM, WITHOUT_BEAM = ", all of it", ", without what is mirrored as a beam"


@dataclass(frozen=True, eq=False)
class Reflectances:
    """Shares of unpolarized light that come back from a scene: ``curves``, (wavelength, mu_i) by what lies beneath, and
    where some of it is mirrored as a beam, with that and without it.

    ``colours`` are "#rrggbb" of the same names, one a mu_i, of the scene under an evenly white, unpolarized sky seen
    from there: by reciprocity the same shares. ``why_none`` says why there are no colours. ``mu_i`` (n,).
    """

    mu_i: Array
    curves: dict[str, Array]
    colours: dict[str, tuple[str, ...]] = field(default_factory=dict)
    why_none: str = ""


def replace_base(scene: Scene) -> tuple[Scene | None, tuple[str, str]]:
    """The scene over black, or over white where it lies on black, and both names; None where no base is reached.

    >>> from vrte import Layer, rayleigh
    >>> replace_base(Scene([Layer(rayleigh(), 1.0, 1.0)], Lambertian(0.3)))[1]
    ('over the base (albedo 0.3)', 'over black')
    """
    if not scene.base_is_reached:
        return None, ("no base is reached", "")
    if scene.base is None:
        return replace(scene, base=Lambertian(1.0)), ("over black", "over white (albedo 1)")
    albedo = f" (albedo {scene.base.even_albedo:g})" if scene.base.orders_reflected == 1 else ""
    return replace(scene, base=None), (f"over the base{albedo}", "over black")


def collect_reflectances(
    wavelength_um: Sequence[float], brdfs: Sequence[Brdf], others: Sequence[Any] = (), names: Sequence[str] = (IN_FILE,)
) -> Reflectances | None:
    """Those of ``brdfs``, one a wavelength, and ``others`` over another base, with ``names``; None without any."""
    if not brdfs:
        return None
    found = (brdfs, others) if len(others) == len(brdfs) else (brdfs,)
    curves: dict[str, Array] = {}
    for name, each in zip(names, found, strict=False):
        diffuse = np.array([one.reflectance for one in each])
        if each[0].specular is None:
            curves[name] = diffuse
        else:
            curves[f"{name}{WITH_BEAM}"] = diffuse + np.array([one.specular[:, 0, 0] for one in each])
            curves[f"{name}{WITHOUT_BEAM}"] = diffuse
    colours, why_none = compute_colours(np.array(wavelength_um), curves)
    return Reflectances(brdfs[0].mu_i, curves, colours, why_none)


def compute_colours(wavelength_um: Array, curves: dict[str, Array]) -> tuple[dict[str, tuple[str, ...]], str]:
    """Colours (mu_i,) of curves (wavelength, mu_i) in sunlight, white where all comes back; or why there are none.

    >>> compute_colours(np.array([0.64]), {})[1]
    'A colour needs at least 5 wavelengths, from 0.46 µm or less to 0.64 µm or more: type 0.43:0.7:7.'
    """
    if wavelength_um.size < FEWEST or wavelength_um[0] > FROM_UM or wavelength_um[-1] < TO_UM:
        return {}, (
            f"A colour needs at least {FEWEST} wavelengths, from {FROM_UM:g} µm or less to {TO_UM:g} µm or more: "
            "type 0.43:0.7:7."
        )
    from vrte.render.colour import make_film, weigh_wavelengths

    try:
        weighed = weigh_wavelengths(wavelength_um)
    except MissingExtraError as error:
        return {}, str(error)
    exposed = make_film(weighed.sum(axis=1))
    return {name: tuple(map(convert_to_hex, exposed((weighed @ curve).T))) for name, curve in curves.items()}, ""
