"""The corners, scenes that are known to be hard, by name, each with what makes it so; and the selections of cases."""

import math
from fnmatch import fnmatchcase
from functools import cache
from typing import Any

from bench.cases import Slab
from bench.stability.cases import ORACLE_NODES, Case, arrange_slabs, find_critical_cosine, make_covering_cases
from bench.stability.surfaces import make_surface_cases
from vrte.basics.errors import SceneError

QUICK_SCENES = 24  # of the covering array, beside the corners
QUICK_SURFACES = ("n=4, trapped over a perfect mirror", "n=1.5, view at the critical cosine")


def define(
    name: str,
    reason: str,
    phase: str = "rayleigh",
    albedo: float = 1.0,
    thickness: float = 1.0,
    layering: str = "one",
    slabs: tuple[Slab, ...] = (),
    base: str = "black",
    media: tuple[float, ...] = (),
    **asked: Any,
) -> Case:
    """A `Case` in short: of slabs, or of a stack of one phase matrix; ``media``: where light is refracted."""
    slabs, main = (slabs, 0) if slabs else arrange_slabs(phase, albedo, thickness, layering)
    asked = {"nodes": 12 if media else 8, "sun": 0.6} | asked
    if media:
        asked = {"media": media, "pile": "corner"} | asked
        layering = ""
    return Case(name, slabs=slabs, main=main, base_kind=base, layering=layering, reason=reason, **asked)


INF = math.inf
NEARLY = 1.0 - 1e-12
# fmt: off
CORNERS: tuple[Case, ...] = (
    define("sun on a node", "the particular solution has the node's own decay rate", sun="node", phase="glass-x1"),
    define("sun and view on a node", "the same pole twice, and a direction that is a node", sun="node", view="node"),
    define("sun on an eigenvalue", "the textbook's particular solution is singular",
           albedo=0.9, sun="eigenvalue", phase="glass-x1"),
    define("sun and view on an eigenvalue", "a double pole in the reconstruction",
           albedo=0.9, thickness=5.0, sun="eigenvalue", view="eigenvalue", phase="metal-x1"),
    define("sun on an eigenvalue, thick", "resonance and decoupled boundaries at once",
           albedo=0.9, thickness=1e4, sun="eigenvalue", view="eigenvalue"),
    define("sun beside a node", "differences of nearly equal exponentials", sun=0.5917173212478249 * (1 + 1e-9)),
    define("mu equals mu0", "transmission along the beam divides by 1/mu - 1/mu0", sun=0.5, view=0.5, albedo=0.99),
    define("mu beside mu0", "the same quotient, 1e-14 away from 0/0", sun=0.5, view=0.5 + 1e-14, albedo=0.99),
    define("normal, conservative, thick", "the sun overhead, T of 1e-6 and a zero eigenvalue",
           thickness=1e6, sun="1", view="1"),
    define("conservative, thickness 100", "a double zero eigenvalue", thickness=1e2),
    define("conservative, thickness 1e4", "T is 1e-4 of R", thickness=1e4, phase="glass-x1"),
    define("conservative, thickness 1e6", "an error of 1e-15 in a1[0] would change T by 1e-3", thickness=1e6),
    define("conservative metal, thickness 1e6", "the same with b2 != 0: eigenvalues in complex pairs",
           thickness=1e6, phase="metal-x1"),
    define("1 - omega = 1e-12, thickness 1e6", "the smallest eigenvalue is 1e-6 of the next, and matters",
           albedo=NEARLY, thickness=1e6),
    define("1 - omega = 1e-9, thickness 1e4", "neither conservative nor absorbing", albedo=1.0 - 1e-9, thickness=1e4),
    define("infinite, conservative", "reflects everything; R converges only as 1/thickness", thickness=INF),
    define("infinite, conservative, under a layer", "everything comes back through the layer above",
           slabs=(Slab("glass-x1", 1.0, 1.0), Slab("rayleigh", 1.0, INF))),
    define("infinite, conservative, over a white base", "the base is never reached", thickness=INF, base="white"),
    define("infinite, 1 - omega = 1e-12", "R differs from 1 by 1e-6", albedo=NEARLY, thickness=INF),
    define("infinite, absorbing", "scaled steps in place of plain doublings",
           albedo=0.5, thickness=INF, phase="metal-x1"),
    define("infinite, grazing", "source and view within 1e-8 of the surface", thickness=INF, sun="1e-8", view="1e-8"),
    define("grazing in and out", "1/mu is 1e8 beside 1", sun="1e-8", view="1e-8", albedo=0.99),
    define("grazing in and out, thin", "thickness/mu is 100 while the layer is 1e-6",
           sun="1e-8", view="1e-8", albedo=0.99, thickness=1e-6),
    define("grazing sun, conservative, thick", "all light starts within 1e-8 of the top", sun="1e-8", thickness=1e6),
    define("thickness 0", "nothing is there", thickness=0.0),
    define("thickness 0 over a white base", "the base as it stands", thickness=0.0, base="white"),
    define("thickness 0 over a lobe", "the lobe's Fourier orders alone", thickness=0.0, base="lobe", view=0.6),
    define("thickness 1e-10", "reflection is 1e-10 of the light: 1 - E keeps 6 digits",
           thickness=1e-10, phase="metal-x1"),
    define("thickness 1e-10 over a white base", "a change of 1e-10 in a reflectance of 1",
           thickness=1e-10, base="white"),
    define("white base under a white slab", "a closed box with one opening", thickness=1e2, base="white"),
    define("white base under a white slab, thick", "light that is never lost, 1e6 deep", thickness=1e6, base="white"),
    define("lobe under a thin layer", "a lobe of more orders than the layer has terms",
           thickness=1e-2, base="lobe", view=0.6),
    define("lobe under a white slab", "polarized light sent back and forth", thickness=10.0, base="lobe"),
    define("g = 0.99 on 1 node", "1500 terms where 2 are carried; order 1 creates energy",
           phase="HG+0.99", albedo=0.99, nodes=1),
    define("g = 0.99 on 16 nodes, conservative", "the peak is far narrower than the nodes", phase="HG+0.99", nodes=16),
    define("g = -0.99 on 16 nodes", "every layer hands the light straight back", phase="HG-0.99", albedo=0.5, nodes=16),
    define("g = 0.99 on 40 nodes, thick", "a peak and diffusion", phase="HG+0.99", albedo=1.0, thickness=1e4, nodes=40),
    define("g = 0.99 on 128 nodes", "256 orders, 128 nodes", phase="HG+0.99", albedo=0.99, nodes=128),
    define("isotropic on 1 node", "the smallest system there is", phase="isotropic", nodes=1),
    define("isotropic on 1 node, thick", "two streams, 1e6 deep", phase="isotropic", nodes=1, thickness=1e6),
    define("thick between thin", "decay rates times thickness from 1e-2 to 1e6 in one system",
           thickness=1e6, layering="thick-between-thin"),
    define("thick between thin, absorbing", "the lower layers are dark to the last bit",
           albedo=0.5, thickness=1e4, layering="thick-between-thin", base="white"),
    define("clear layer between", "a layer whose every mode is a node's", layering="clear-between"),
    define("clear layer between, conservative, thick", "absorption without scattering inside a white slab",
           thickness=1e4, layering="clear-between"),
    define("clear layer alone", "no multiple scattering at all", albedo=0.0, base="white"),
    define("identical neighbours, conservative, thick", "joins of layers that are one layer",
           thickness=1e6, layering="identical-neighbours"),
    define("hundred layers, conservative, thick", "99 joints of slabs that transmit little",
           thickness=1e6, layering="hundred"),
    define("hundred thin layers", "99 joints of slabs that do nothing",
           thickness=1e-6, layering="hundred", albedo=0.99),
    define("transmission near 1e-80", "relative digits of light that is nearly gone", albedo=0.5, thickness=1e2),
    define("transmission that underflows", "e^-8000: below the smallest number there is", albedo=0.5, thickness=1e4),
    define("transmission that underflows onto a lobe", "nothing comes back from below",
           albedo=0.5, thickness=1e4, base="lobe"),
    define("omega = 1e-12", "multiple scattering is 1e-12 of single scattering", albedo=1e-12),
    define("mu = 1 off the plane of incidence", "at the pole the meridian plane is the azimuth's", sun="1", view="1",
           orders=(0, 2), phase="metal-x1"),
    define("1e-12 from the normal", "sqrt(1 - mu^2) keeps 6 digits", sun="1-1e-12", view="1-1e-12", orders=(0, 2)),
    define("the same direction many times", "duplicates must not make a system singular",
           extra_mu=(0.35, 0.35, -0.35, 0.5, 0.6)),
    define("circular light", "V alone carries polarization", beam=(1.0, 0.0, 0.0, 1.0), phase="metal-x1"),
    define("linear light at 45 degrees", "U alone carries polarization", beam=(1.0, 0.0, 1.0, 0.0), phase="metal-x1"),
    define("a metal sphere's order 20", "an order far above those that diffuse", phase="metal-x30", albedo=0.94,
           thickness=1e2, nodes=16, orders=(0, 20)),
    define("large glass spheres on 16 nodes", "487 terms where 32 are carried",
           phase="glass-x200", albedo=0.5, nodes=16),
    define("haze L, conservative, thick", "a forward peak, 1e4 deep", phase="haze-L", thickness=1e4, nodes=16),
)
GLASS, DENSE = (1.0, 1.5, 1.5), (1.0, 4.0, 4.0)  # media: under a surface
CRITICAL = find_critical_cosine(GLASS)
SURFACE_CORNERS: tuple[Case, ...] = (
    define("n=4, trapped over a perfect mirror", "15 of 16 parts of the light are turned back, none is lost",
           media=DENSE, base="perfect mirror", phase="metal-x1"),
    define("n=4, trapped over a perfect mirror, thin", "no place where light is scattered out of the trap but 1e-6",
           media=DENSE, base="perfect mirror", thickness=1e-6),
    define("n=4, trapped over a perfect mirror, thick", "it finds its way out from 1e6 deep",
           media=DENSE, base="perfect mirror", thickness=1e6),
    define("n=4, trapped over a metal", "every way back to the surface passes an absorbing mirror",
           media=DENSE, base="mirror", phase="spheroids"),
    define("n=4, a closed box", "a white base under a white slab, and a surface that hardly opens",
           media=DENSE, base="white", phase="spheroids", thickness=1e2),
    define("n=4, infinite, conservative", "everything comes out again, sooner or later", media=DENSE, thickness=INF),
    define("n=4, plate between mirrors of itself", "both faces reflect totally below the same cosine",
           media=(1.0, 4.0, 1.0), phase="glass-x1"),
    define("n=1.5, view at the critical cosine", "T of the surface has a square-root edge, hit to the last bit",
           media=GLASS, view="critical",
           extra_mu=(math.nextafter(CRITICAL, 1.0), -math.nextafter(CRITICAL, 1.0), math.nextafter(CRITICAL, 0.0))),
    define("n=1/1.5, sun at the critical cosine", "the refracted beam goes along the surface",
           media=(1.5, 1.0, 1.0), sun="critical", view="critical"),
    define("n=1/1.5, sun above the critical cosine", "one unit in the last place: cosine 2e-8 behind the surface",
           media=(1.5, 1.0, 1.0), sun=math.nextafter(CRITICAL, 1.0)),
    define("n=1/1.5, sun below the critical cosine", "one unit in the last place: all of the beam is reflected",
           media=(1.5, 1.0, 1.0), sun=math.nextafter(CRITICAL, 0.0)),
    define("n=1.5, sun grazing", "it enters at the critical angle", media=GLASS, sun="1e-8", view="1e-8", albedo=0.99),
    define("n=1.5, sun grazing, thin plate", "what enters is 1e-8 of it, and crosses 1e-6",
           media=(1.0, 1.5, 1.0), sun="1e-8", view="1e-8", base="white", albedo=0.99, thickness=1e-6),
    define("n=1.0001, grazing", "a surface that reflects nothing but what is beyond 89 degrees",
           media=(1.0, 1.0001, 1.0001), sun="1e-8", view="critical"),
    define("n=1.0001, conservative, thick", "one panel of nodes is 0.014 wide, thickness 1e6",
           media=(1.0, 1.0001, 1.0001), thickness=1e6),
    define("n=1/1.5, gap of air in glass", "light of the gap is all that gets across", phase="metal-x1",
           media=(1.5, 1.0, 1.5), view="critical"),
    define("n=1/1.5, empty gap of air in glass", "nothing scatters, and most is reflected totally", albedo=0.0,
           thickness=0.0, media=(1.5, 1.0, 1.5), sun="critical", view="critical"),
    define("n=2.7, thickness 0 over a white base", "the surface and the base alone",
           media=(1.0, 2.7, 2.7), thickness=0.0, base="white"),
    define("n=1.5, hundred layers", "99 joints that are none, and one", media=(1.0,) + 101 * (1.5,),
           layering="hundred", thickness=1e2, nodes=8),
    define("n=1, over a perfect mirror", "nothing refracts: the mirror alone turns beams", media=(1.0, 1.0, 1.0),
           base="perfect mirror", thickness=1e2),
    define("n=1.33, haze L on few nodes", "82 terms where 16 are carried",
           phase="haze-L", media=(1.0, 1.33, 1.33), nodes=16, albedo=0.9),
)
# fmt: on


@cache
def list_all_cases() -> tuple[Case, ...]:
    """The corners and the covering array, without surfaces and then with them, names unique.

    >>> len(list_all_cases()) >= 450
    True
    """
    return (*CORNERS, *make_covering_cases(), *SURFACE_CORNERS, *make_surface_cases())


def list_oracle_cases() -> tuple[Case, ...]:
    """The cases of at most 16 nodes, which ball arithmetic can answer.

    >>> max(case.nodes for case in list_oracle_cases())
    16
    """
    return tuple(case for case in list_all_cases() if case.nodes <= ORACLE_NODES and not case.media)


def choose_quick_cases() -> tuple[Case, ...]:
    """Every second corner and some scenes, of at most 16 nodes that carry all terms, without a hundred layers; and two
    under surfaces.

    >>> 40 <= len(choose_quick_cases()) <= 60
    True
    """
    small = [case for case in list_oracle_cases() if case.resolved and case.layering != "hundred"]
    corners = [case for case in small if case.reason]
    surfaces = [case for case in SURFACE_CORNERS if case.name in QUICK_SURFACES]
    scenes = [case for case in small if not case.reason]
    return (*corners[::2], *scenes[:: len(scenes) // QUICK_SCENES][:QUICK_SCENES], *surfaces)


def find_matching_cases(pattern: str, quick: bool = False) -> list[Case]:
    """The cases whose names match a shell's pattern, of all or of the quick selection. Raises SceneError for none.

    >>> [case.name for case in find_matching_cases("thickness 0*lobe")]
    ['thickness 0 over a lobe']
    """
    found = [case for case in (choose_quick_cases() if quick else list_all_cases()) if fnmatchcase(case.name, pattern)]
    if not found:
        raise SceneError(f"--cases {pattern!r} matches no scene{' of the quick selection' if quick else ''}")
    return found
