"""Polarized subsurface reflectance of particulate layers: the public names."""

from vrte.basics import starting  # noqa: F401  # first of all: Ctrl-C while the rest loads

# isort: split
import sys as _sys
from importlib import metadata as _metadata

from vrte.basics.waiting import wait_passively

try:
    with wait_passively():
        import vrte._core  # noqa: F401
except ModuleNotFoundError as error:
    if error.name != "vrte._core":
        raise
    from pathlib import Path

    raise ImportError(
        f"{Path(__file__).parent} holds vrte's sources without their compiled core: start Python in another folder to "
        "use the vrte that is installed, or build it here by 'make env' or 'pip install --editable .'"
    ) from None

from vrte.appearance.appearance import Appearance, appearance
from vrte.appearance.paint import Paint, paint
from vrte.basics.arguments import open_front_door as _open_front_door
from vrte.basics.errors import (
    AccuracyError,
    AccuracyWarning,
    DeviceError,
    FittedRangeWarning,
    IndistinguishableWarning,
    LongSolveWarning,
    MisfitWarning,
    MissingExtraError,
    SceneError,
    SweepError,
    UnitsWarning,
)
from vrte.calls.brdf import brdf
from vrte.calls.brdfs import brdfs
from vrte.calls.linearize import Linearized, linearize
from vrte.calls.material import material
from vrte.calls.mitsuba import to_mitsuba
from vrte.calls.plan import plan
from vrte.calls.radiance import radiance
from vrte.calls.solve_base import solve_base
from vrte.calls.spectrum import spectrum
from vrte.calls.versions import show_versions
from vrte.calls.views import views
from vrte.discrete_ordinates.derivatives.adjoint import Gradient
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.fit import Fit, Measurement, fit, read_measurement
from vrte.formats import load
from vrte.formats.base_file import read_base
from vrte.formats.index_table import read_index
from vrte.formats.materials import list_materials as materials
from vrte.formats.scattering import read_scattering
from vrte.formats.scene_family import SceneFamily
from vrte.formats.size_table import read_sizes
from vrte.optics.coated_spheres import coated_spheres
from vrte.optics.convention_card import recognise_convention
from vrte.optics.crowding import IndependentScatteringWarning, PackingWarning
from vrte.optics.particles import Particles, mixture
from vrte.optics.phase_matrix import NegativeScatteringWarning, PhaseMatrix, henyey_greenstein, isotropic, mix, rayleigh
from vrte.optics.refractive_index import IndexTable, refractive_index
from vrte.optics.shapes import cylinders, spheroids
from vrte.optics.size_distribution import Gamma, Lognormal, Monodisperse, Tabulated
from vrte.optics.spheres import spheres
from vrte.results import over_hemisphere, quantities
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.results.spectrum import Spectrum
from vrte.results.views import Views
from vrte.scene.boundary import Boundary as _Boundary
from vrte.scene.boundary import Lambertian, MuellerBase
from vrte.scene.cox_munk import cox_munk
from vrte.scene.facets import Facets
from vrte.scene.hapke import Hapke
from vrte.scene.illumination import hemisphere
from vrte.scene.interface import Interface
from vrte.scene.layer import Layer
from vrte.scene.mirror import Mirror
from vrte.scene.ross_li import RossLi
from vrte.scene.rpv import RPV
from vrte.scene.scene import Scene
from vrte.scene.tabulated_base import CoarseTableWarning, TabulatedBase
from vrte.scene.variation import Variation
from vrte.sweep import interpolate, sweep

try:
    __version__ = _metadata.version("vrte")
except _metadata.PackageNotFoundError:  # built in place and never installed
    __version__ = "0+unknown"

_INNER = ("quadrature", "compute_elements", "compute_f", "compute_phase_function", "weigh")  # called while solving

__all__ = [
    "RPV",
    "AccuracyError",
    "AccuracyWarning",
    "Appearance",
    "Brdf",
    "CoarseTableWarning",
    "DeviceError",
    "Facets",
    "Field",
    "Fit",
    "FittedRangeWarning",
    "Gamma",
    "Gradient",
    "Hapke",
    "IndependentScatteringWarning",
    "IndexTable",
    "IndistinguishableWarning",
    "Interface",
    "Lambertian",
    "Layer",
    "Linearized",
    "Lognormal",
    "LongSolveWarning",
    "Measurement",
    "Mirror",
    "MisfitWarning",
    "MissingExtraError",
    "Monodisperse",
    "MuellerBase",
    "NegativeScatteringWarning",
    "PackingWarning",
    "Paint",
    "Particles",
    "PhaseMatrix",
    "Plan",
    "RossLi",
    "Scene",
    "SceneError",
    "SceneFamily",
    "Spectrum",
    "SweepError",
    "Tabulated",
    "TabulatedBase",
    "UnitsWarning",
    "Variation",
    "Views",
    "appearance",
    "brdf",
    "brdfs",
    "coated_spheres",
    "cox_munk",
    "cylinders",
    "fit",
    "hemisphere",
    "henyey_greenstein",
    "interpolate",
    "isotropic",
    "linearize",
    "load",
    "material",
    "materials",
    "mix",
    "mixture",
    "over_hemisphere",
    "paint",
    "plan",
    "quantities",
    "radiance",
    "rayleigh",
    "read_base",
    "read_index",
    "read_measurement",
    "read_scattering",
    "read_sizes",
    "recognise_convention",
    "refractive_index",
    "show_versions",
    "solve_base",
    "spectrum",
    "spheres",
    "spheroids",
    "sweep",
    "to_mitsuba",
    "views",
]

_open_front_door(_sys.modules[__name__], __all__, inner=[*vars(_Boundary), *_INNER])
