"""Polarized subsurface reflectance of particulate layers: the public names."""

from vrte import starting  # noqa: F401  # first of all: Ctrl-C while the rest loads

# isort: split
try:
    import vrte._core  # noqa: F401
except ModuleNotFoundError as error:
    if error.name != "vrte._core":
        raise
    from pathlib import Path

    raise ImportError(
        f"{Path(__file__).parent} holds vrte's sources without their compiled core: start Python in another folder to "
        "use the vrte that is installed, or build it here by 'make env' or 'pip install --editable .'"
    ) from None

from vrte import over_hemisphere, quantities
from vrte.batch import brdfs
from vrte.brdf import Brdf, brdf
from vrte.errors import (
    AccuracyError,
    AccuracyWarning,
    DeviceError,
    LongSolveWarning,
    MissingExtraError,
    SceneError,
    SweepError,
)
from vrte.field import Field, radiance
from vrte.formats import load
from vrte.formats.index_table import read_index
from vrte.formats.measured_polarized import to_mitsuba
from vrte.geometries import Views, views
from vrte.illumination import hemisphere
from vrte.optics.phase_matrix import NegativeScatteringWarning, PhaseMatrix, henyey_greenstein, isotropic, mix, rayleigh
from vrte.optics.refractive_index import IndexTable, UnitsWarning, refractive_index
from vrte.optics.size_distribution import Gamma, Lognormal, Monodisperse
from vrte.optics.spheres import Particles, mixture, spheres
from vrte.plan import Plan
from vrte.plan_call import plan
from vrte.scene import IndependentScatteringWarning, Lambertian, Layer, MuellerBase, Scene
from vrte.spectrum import Spectrum, spectrum
from vrte.sweep import interpolate, sweep

__version__ = "0.1.0"

__all__ = [
    "AccuracyError",
    "AccuracyWarning",
    "Brdf",
    "DeviceError",
    "Field",
    "Gamma",
    "IndependentScatteringWarning",
    "IndexTable",
    "Lambertian",
    "Layer",
    "Lognormal",
    "LongSolveWarning",
    "MissingExtraError",
    "Monodisperse",
    "MuellerBase",
    "NegativeScatteringWarning",
    "Particles",
    "PhaseMatrix",
    "Plan",
    "Scene",
    "SceneError",
    "Spectrum",
    "SweepError",
    "UnitsWarning",
    "Views",
    "brdf",
    "brdfs",
    "hemisphere",
    "henyey_greenstein",
    "interpolate",
    "isotropic",
    "load",
    "mix",
    "mixture",
    "over_hemisphere",
    "plan",
    "quantities",
    "radiance",
    "rayleigh",
    "read_index",
    "refractive_index",
    "spectrum",
    "spheres",
    "sweep",
    "to_mitsuba",
    "views",
]
