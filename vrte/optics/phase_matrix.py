"""Scattering matrices as expansion coefficients in generalized spherical functions.

Signs are those of Hovenier, de Haan and Mishchenko (docs/reference/conventions.md): F(angle) has the elements a1, a2,
a3, a4 on its diagonal, b1 in its upper block and b2 in its lower one; a1 and a4 expand in P_l, a2 +- a3 in
P^l_2,+-2, b1 and b2 in P^l_02 = -d^l_02.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import (
    Array,
    check_fields,
    check_list,
    check_number,
    check_numbers,
    check_vector,
    check_whole,
    count_items,
    freeze_copy,
    make_readonly,
    show_value,
)
from vrte.basics.errors import SceneError, warn_user
from vrte.basics.quadrature import compute_wigner_functions
from vrte.basics.views import view

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vrte.optics.angle_tables import Expansion, ScatteringTable

CHECK_ANGLES_DEG = np.linspace(180.0, 0.0, 721)
CHECK_COSINES = np.cos(np.radians(CHECK_ANGLES_DEG))  # ascending
MOST_TERMS = 100_000  # more than any particle has that can be computed; as many take seconds to check
LEFT_OUT = 1e-12  # sum of the terms of a Henyey-Greenstein phase function that are left out, over its mean
MOST_KINDS = 10_000  # in a mixture
LARGEST_COEFFICIENT = 1e9  # far above the 2 l + 1 of any particle, far below overflow
NEGATIVE_ALLOWED = 1e-4  # -(coherency eigenvalue)/F11 that is allowed: tables rounded to a few digits pass
CUT_SHORT = 0.1  # -(coherency eigenvalue) over the mean of F11 that comes from blunders, not from a cut expansion
ROUNDING = 1e-13  # of the sum of all |coefficients|: what double precision makes of an F11 that vanishes
UNSURE = 1e-15  # of the same sum and of the terms: rounding of plain recurrences, which was 2.5e-16 at most
ANGLES_AT_ONCE = 4096  # bounds the memory, whatever the number of angles
SEQUENCES = ("a1", "a2", "a3", "a4", "b1", "b2")
PLACES = ((0, 0), (1, 1), (2, 2), (3, 3), (0, 1), (2, 3), (1, 0), (3, 2))  # of a1, a2, a3, a4, b1, b2, b1, -b2 in F
PAIRS = ((0, 0), (0, 2), (2, 2), (2, -2))  # (m, n) of the Wigner functions that the six sequences multiply


class NegativeScatteringWarning(UserWarning):
    """A phase matrix is negative somewhere by more than rounding, which its tolerance allows."""


@dataclass(frozen=True, eq=False, repr=False)
class PhaseMatrix:
    """The scattering matrix of randomly oriented particles, as six lists of expansion coefficients.

    Parameters
    ----------
    a1 : array_like (terms,)
        Of F11, in Legendre polynomials, from degree l = 0 on: ``a1[0]`` is 1 (within 1e-6; all are divided by it),
        ``a1[1]`` is 3 g. Alone it is a scalar phase function. Shorter lists are padded with zeros.
    a2, a3 : array_like (terms,), optional
        Of F22 and F33, a2 +- a3 in generalized spherical functions; what stands below l = 2 plays no part.
    a4 : array_like (terms,), optional
        Of F44, in Legendre polynomials.
    b1, b2 : array_like (terms,), optional
        Of F12 and F34, in generalized spherical functions; what stands below l = 2 plays no part.
    tolerance : float
        0 to 1, of the mean of F11 over the sphere: lets expansions pass that are cut short or misprinted, with a
        NegativeScatteringWarning that says by how much they are negative.
    expansion : Expansion or None
        Of one from a table over angle (`from_angles`): the table, its integral, and what the expansion leaves out.

    Raises
    ------
    SceneError
        For a shape, a value that is not finite, or a matrix that no particles can have: a coherency eigenvalue below
        -1e-4 F11 and below -tolerance at one of 721 angles.

    References
    ----------
    (1:9); Siewert, Astron. Astrophys. 109, 195 (1982).

    Examples
    --------
    >>> import vrte
    >>> vrte.PhaseMatrix([1.0, 0.75]).asymmetry
    0.25
    """

    a1: Array
    a2: Array = None  # type: ignore[assignment]
    a3: Array = None  # type: ignore[assignment]
    a4: Array = None  # type: ignore[assignment]
    b1: Array = None  # type: ignore[assignment]
    b2: Array = None  # type: ignore[assignment]
    tolerance: float = field(default=0.0, kw_only=True)
    expansion: "Expansion | None" = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        check_fields("", self, {"tolerance": (0.0, 1.0, "between 0 and 1, of the mean of F11 over the sphere")})
        lists = {name: given for name in SEQUENCES if (given := getattr(self, name)) is not None}
        for name, given in lists.items():
            if count_items(given) > MOST_TERMS:
                raise SceneError.of(name, f"must be at most {MOST_TERMS} coefficients, not {count_items(given)}")
            lists[name] = check_vector(name, given)
            if (largest := float(np.abs(lists[name]).max())) > LARGEST_COEFFICIENT:
                raise SceneError.of(name, f"holds {largest:g}: a coefficient is at most 2 l + 1 in size")
        scale = lists["a1"][0]
        if abs(scale - 1.0) > 1e-6:
            raise SceneError(f"a1[0] must be 1 within 1e-6 (the mean of F11 over the sphere), not {scale}")
        rows = np.zeros((len(SEQUENCES), max(values.size for values in lists.values())))
        for name, row in zip(SEQUENCES, rows, strict=True):
            if name in lists:
                row[: lists[name].size] = lists[name] / scale
            object.__setattr__(self, name, make_readonly(row))
        self._check_physical()

    @classmethod
    def from_angles(
        cls,
        angle_deg: Any,
        F11: Any,
        F12: Any = None,
        F22: Any = None,
        F33: Any = None,
        F34: Any = None,
        F44: Any = None,
        *,
        convention: str = "vrte",
        normalise: bool = False,
        spheres: bool = False,
        ends: str | None = None,
        accuracy: float | None = None,
        tolerance: float = 0.0,
    ) -> "PhaseMatrix":
        """The phase matrix of a scattering matrix tabulated over scattering angles [degrees], ascending from 0 to 180.

        F11 to F44 (angles,) are the elements, or what ``convention`` has in their places: a name of
        `vrte.optics.conventions.CONVENTIONS` (docs/how_to/importing.md); F11 alone is a scalar phase function.
        ``normalise`` divides by the mean of F11 over the sphere, which must otherwise be within 5 % of the
        convention's. ``spheres``: F22 = F11 and F44 = F33, which are left out then. A table that does not reach 0 or
        180 degrees is refused, or goes on with ``ends="extrapolate"``: log F11 and the ratios as parabolas, which a
        peak of diffraction may well exceed. ``accuracy`` is the largest error over F11 that may remain at an angle of
        the table (5e-5 where it is interpolated, rounding elsewhere), ``tolerance`` as of a PhaseMatrix.

        Its ``expansion`` tells the integral found and the errors. Between the angles it is exact where they are a
        quadrature (even steps from 0 to 180 degrees, Gauss-Legendre) that the matrix does not exceed, elsewhere a
        spline of log F11 and of the ratios to it. An AccuracyWarning tells of steps that may miss a peak, and of an
        accuracy that 4096 terms do not reach. Source: de Rooij and van der Stap, Astron. Astrophys. 131, 237 (1984),
        section 3; coherency test: Hovenier and van der Mee, JQSRT 55, 649 (1996).
        """
        from vrte.optics.angle_tables import expand_table

        columns = (F11, F12, F22, F33, F34, F44)
        return expand_table(angle_deg, columns, convention, normalise, spheres, ends, accuracy, tolerance)

    def to_angles(self, angle_deg: Any = None) -> "ScatteringTable":
        """The six elements over scattering angles [degrees] (angles,), by default steps of an exact quadrature."""
        from vrte.optics.angle_tables import tabulate_phase_matrix

        return tabulate_phase_matrix(self, angle_deg)

    @property
    def terms(self) -> int:
        """The number of degrees of the expansion, l = 0 .. terms - 1."""
        return int(self.a1.size)

    @cached_property
    def coefficients(self) -> Array:
        """The expansion coefficients (terms, 6): columns a1, a2, a3, a4, b1, b2; read-only."""
        return make_readonly(np.array([getattr(self, name) for name in SEQUENCES]).T.copy())

    @property
    def asymmetry(self) -> float:
        """The asymmetry g, the mean cosine of the scattering angle."""
        return float(self.a1[1] / 3.0) if self.terms > 1 else 0.0

    @cached_property
    def is_scalar(self) -> bool:
        """True where only a1 differs from zero: polarization plays no part."""
        return not self.coefficients[:, 1:].any()

    def scattering_matrix(self, angle_deg: Any) -> Array:
        """The scattering matrix F (..., 4, 4), referred to the scattering plane, at angles [degrees] (...)."""
        angles = check_numbers("angle_deg", angle_deg)
        if not np.isfinite(angles).all():
            raise SceneError("angle_deg must be finite scattering angles in degrees; NaN or inf was found")
        cosine = np.cos(np.radians(angles.ravel()))
        ascending = np.argsort(cosine)
        elements = self.compute_elements(cosine[ascending])
        matrix = np.zeros((angles.size, 4, 4))
        for (row, column), values in zip(PLACES, (*elements, elements[4], -elements[5]), strict=True):
            matrix[ascending, row, column] = values
        return matrix.reshape(*angles.shape, 4, 4)

    def __repr__(self) -> str:
        return f"PhaseMatrix({self.in_words})"

    @property
    def in_words(self) -> str:
        """Its asymmetry, terms and kind."""
        terms = "1 term" if self.terms == 1 else f"{self.terms} terms"
        return f"g {self.asymmetry:.4g}, {terms}, {'scalar' if self.is_scalar else 'polarizing'}"

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")

    def plot(self) -> "Figure":
        """A matplotlib figure of F11 and of the other elements over it against the angle, beside the own table."""
        return view(self, "plot")

    def compute_elements(self, cosine: Array, gap: Array | None = None) -> Array:
        """F11, F22, F33, F44, F12, F34 (6, n) at ascending cosines (n,); ``gap`` is 1 - |cosine|, with more digits."""
        plain, crossed = np.stack([self.a1, self.a4]), -np.stack([self.b1, self.b2])  # P^l_02 = -d^l_02
        total, difference = self.a2 + self.a3, self.a2 - self.a3
        sums = np.zeros((6, cosine.size))
        for here in np.array_split(np.arange(cosine.size), 1 + cosine.size // ANGLES_AT_ONCE):
            some = slice(here[0], here[-1] + 1) if here.size else slice(0)
            found, differences = sums[:, some], None if gap is None else gap[some]
            for first, block in compute_wigner_functions(PAIRS, self.terms, cosine[some], differences):
                part = slice(first, first + len(block))
                found[:2] += plain[:, part] @ block[:, 0]
                found[2:4] += crossed[:, part] @ block[:, 1]
                found[4] += total[part] @ block[:, 2]
                found[5] += difference[part] @ block[:, 3]
        a1, a4, b1, b2, plus, minus = sums
        return np.stack([a1, 0.5 * (plus + minus), 0.5 * (plus - minus), a4, b1, b2])

    @cached_property
    def series(self) -> Array:
        """The table (terms, SERIES) of recurrences and coefficients by which the compiled core sums the expansion."""
        return make_readonly(_core.series_table(self.coefficients))

    def _check_physical(self) -> None:
        # plain recurrences first; their rounding, of which `unsure` is several times the largest that was met, may hide
        # or feign a fault: there the ones that keep the digits decide
        a1, a4, b1, b2, plus, minus = _core.sum_elements(self.series, CHECK_COSINES)
        total = float(np.abs(self.coefficients).sum())
        unsure = UNSURE * self.terms * total
        floor = -NEGATIVE_ALLOWED * np.abs(a1) - ROUNDING * total
        if self.is_scalar and (0.25 * a1 >= floor + unsure).all():  # a quarter of F11 is the eigenvalue
            return
        elements = np.stack([a1, 0.5 * (plus + minus), 0.5 * (plus - minus), a4, b1, b2])
        doubtful = np.flatnonzero(find_lowest_coherency_eigenvalue(*elements) < floor + unsure)
        if not doubtful.size:
            return
        elements[:, doubtful] = self.compute_elements(CHECK_COSINES[doubtful])
        a1, lowest = elements[0], find_lowest_coherency_eigenvalue(*elements)
        floor = -NEGATIVE_ALLOWED * np.abs(a1) - ROUNDING * total
        worst = int(np.argmin(lowest - floor))
        if lowest[worst] >= floor[worst]:
            return
        fault = (
            f"at a scattering angle of {CHECK_ANGLES_DEG[worst]:g} degrees its coherency matrix has the eigenvalue "
            f"{lowest[worst]:.3g} where F11 is {a1[worst]:.3g}"
        )
        enough = -1.1 * float(lowest.min())
        off = 0.0 if self.expansion is None else 2.0 * self.expansion.largest_error
        excused = (lowest >= floor - off * np.abs(a1)).all()  # the table itself has passed the test
        if enough > 1.1 * self.tolerance and not excused:
            cure = f"; if it was cut short, tolerance={enough:.2g} takes it with a warning" * (enough < CUT_SHORT)
            raise SceneError(
                f"the phase matrix is not physical: {fault}; at least -{NEGATIVE_ALLOWED:g} F11 is allowed (check the "
                f"signs, the order and the number of terms{cure})"
            )
        if excused:  # what is made of it, a mixture, is allowed as much
            object.__setattr__(self, "tolerance", max(self.tolerance, enough))
        why = f"its expansion is off by {off / 2.0:.2g}" if excused else f"tolerance {self.tolerance:g} allows"
        warn_user(
            f"the phase matrix is not quite physical: {fault}; taken, as {why}, but light may come out negative or too "
            "polarized",
            NegativeScatteringWarning,
        )

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, values in state.items():  # pickle forgets that an array is read-only
            object.__setattr__(self, name, freeze_copy(values) if isinstance(values, np.ndarray) else values)


def project_elements(cosine: Array, combined: Array, terms: int, difference: Array | None = None) -> Array:
    """Integrals over the cosine (terms, 6, ...) of ``combined`` (6, n, ...), on ascending nodes (n,), weighted:
    F11 and F44 with d^l_00, -F12 and -F34 with d^l_02, F22 + F33 with d^l_22, F22 - F33 with d^l_2,-2."""
    more = combined.shape[2:]
    plain, crossed = (np.stack((combined[k], combined[k + 1]), axis=1).reshape(cosine.size, -1) for k in (0, 2))
    sums = np.empty((terms, 6, *more))
    for first, block in compute_wigner_functions(PAIRS, terms, cosine, difference):
        rows = slice(first, first + len(block))
        sums[rows, :2], sums[rows, 2:4] = (
            (block[:, kind] @ pair).reshape(-1, 2, *more) for kind, pair in enumerate((plain, crossed))
        )
        sums[rows, 4], sums[rows, 5] = block[:, 2] @ combined[4], block[:, 3] @ combined[5]
    return sums


def arrange_coefficients(sums: Array) -> tuple[Array, ...]:
    """a1, a2, a3, a4, b1, b2 from integrals (terms, 6) that have their factor."""
    a1, a4, b1, b2, total, difference = sums.T
    return a1, 0.5 * (total + difference), 0.5 * (total - difference), a4, b1, b2


def find_lowest_coherency_eigenvalue(a1: Array, a2: Array, a3: Array, a4: Array, b1: Array, b2: Array) -> Array:
    """The lowest eigenvalue of the coherency matrix H = sum_ij F_ij (sigma_i x sigma_j^*)/4, here of two 2x2 blocks,
    which no real particle makes negative. Source: Hovenier and van der Mee, JQSRT 55, 649 (1996)."""
    outer = a1 + a2 - np.sqrt((a3 + a4) ** 2 + 4.0 * (b1**2 + b2**2))
    inner = a1 - a2 - np.abs(a3 - a4)
    return 0.25 * np.minimum(outer, inner)


def isotropic() -> PhaseMatrix:
    """Scattering evenly into all directions, which leaves no polarization.

    Returns
    -------
    PhaseMatrix
        Of one term.

    Examples
    --------
    >>> import vrte
    >>> vrte.isotropic().terms
    1
    """
    return PhaseMatrix(np.array([1.0]))


def rayleigh(depolarization: float = 0.0) -> PhaseMatrix:
    """Scattering by particles much smaller than the wavelength.

    Parameters
    ----------
    depolarization : float
        rho, from 0 to 6/7.

    Returns
    -------
    PhaseMatrix
        Of three terms, (1:9).

    References
    ----------
    Hansen and Travis, Space Sci. Rev. 16, 527 (1974), there with Delta = (1 - rho)/(1 + rho/2).

    Examples
    --------
    >>> import vrte
    >>> vrte.rayleigh().a1.tolist()
    [1.0, 0.0, 0.5]
    """
    return make_rayleigh(check_number("depolarization", depolarization, 0.0, 6.0 / 7.0, "between 0 and 6/7"))


@lru_cache(maxsize=64)
def make_rayleigh(rho: float) -> PhaseMatrix:
    """The same, made and checked once."""
    r = (1.0 - rho) / (1.0 + rho / 2.0)
    a4 = 3.0 * (1.0 - 2.0 * rho) / (2.0 + rho)
    rows = [1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, a4, 0.0], [r / 2.0, 3.0 * r, 0.0, 0.0, np.sqrt(6.0) * r / 2.0]
    return PhaseMatrix(*np.array(rows).T)


def henyey_greenstein(g: float, terms: int | None = None) -> PhaseMatrix:
    """The scalar phase function of Henyey and Greenstein, a1[l] = (2l+1) g^l.

    Parameters
    ----------
    g : float
        Asymmetry, between -1 and 1.
    terms : int, optional
        Degrees that are kept; left out: so many that the others add up to less than 1e-12 of the mean, as in a scene
        file.

    Returns
    -------
    PhaseMatrix
        Of ``terms`` terms, a1 alone.

    Raises
    ------
    SceneError
        For another g, for no terms or more than 100000, or where the cut leaves a phase function that is negative
        somewhere: it then takes more terms.

    References
    ----------
    Henyey and Greenstein, Astrophys. J. 93, 70 (1941).

    Examples
    --------
    >>> import vrte
    >>> vrte.henyey_greenstein(0.5, 40).asymmetry, vrte.henyey_greenstein(0.5).terms
    (0.5, 50)
    """
    value = check_number("g", g, -1.0 + 1e-12, 1.0 - 1e-12, "between -1 and 1, both excluded")
    if terms is None and (terms := count_henyey_greenstein_terms(value)) > MOST_TERMS:
        raise SceneError(f"g = {value!r} takes {terms} terms, and at most {MOST_TERMS} are allowed")
    degrees = np.arange(check_whole("terms", terms, 1, MOST_TERMS))
    try:
        return PhaseMatrix((2.0 * degrees + 1.0) * value**degrees)
    except SceneError:
        enough = count_henyey_greenstein_terms(value)
        advice = "are enough" if enough <= MOST_TERMS else f"would be, at most {MOST_TERMS} are allowed"
        raise SceneError(
            f"henyey_greenstein: {degrees.size} terms are too few for g = {value!r} (the phase function turns "
            f"negative somewhere); {enough} {advice}"
        ) from None


def count_henyey_greenstein_terms(g: float) -> int:
    """The number of terms beyond which all others add up to less than 1e-12 of the phase function's mean."""
    size = min(abs(g), 1.0 - 1e-6)  # what is nearer to 1 has far too many anyway
    terms = 2
    while size and size**terms * (2 * terms + 1) / (1.0 - size) ** 2 > LEFT_OUT:
        terms = math.ceil(1.05 * terms)
    return terms


def mix(parts: Annotated[Sequence[tuple[PhaseMatrix, float]], Any]) -> PhaseMatrix:
    """The mean phase matrix of several kinds of particles, weighted by what each scatters.

    Parameters
    ----------
    parts : sequence of (PhaseMatrix, float)
        Each with a weight >= 0: its scattering cross section times its number.

    Returns
    -------
    PhaseMatrix
        Of as many terms as the longest has.

    References
    ----------
    (1:9); Hansen and Travis, Space Sci. Rev. 16, 527 (1974).

    Examples
    --------
    >>> import vrte
    >>> vrte.mix([(vrte.isotropic(), 1.0), (vrte.rayleigh(), 1.0)]).a1.tolist()
    [1.0, 0.0, 0.25]
    """
    pairs = check_mixture(parts, PhaseMatrix, "phase matrix, weight", "vrte.mixture mixes particles")
    weights = check_vector("the weights of a mixture", [weight for _, weight in pairs])
    if (weights < 0.0).any() or not weights.any():
        raise SceneError(f"the weights of a mixture must be >= 0 and not all zero, not {show_value(weights.tolist())}")
    weights = weights / weights.max()  # their sum cannot overflow
    total = np.zeros((max(matrix.terms for matrix, _ in pairs), 6))
    for (matrix, _), weight in zip(pairs, weights / weights.sum(), strict=True):
        total[: matrix.terms] += weight * matrix.coefficients
    total[0, 0] = 1.0  # exactly, whatever the weights' rounding: energy is conserved to the last digit
    return PhaseMatrix(*total.T, tolerance=max(matrix.tolerance for matrix, _ in pairs))


def check_mixture(parts: Any, kind_of: type, pair: str, other: str) -> list[tuple[Any, Any]]:
    """The parts of a mixture, one pair (kind, share) or more; errors name the ``pair`` and the ``other`` call."""
    found = check_list("the parts of a mixture", parts, MOST_KINDS)
    try:
        pairs = [(kind, share) for kind, share in found]
    except Exception:
        raise SceneError(f"a mixture needs pairs ({pair})") from None
    if not pairs:
        raise SceneError("a mixture needs at least one kind of particle, not an empty list")
    for kind, _ in pairs:
        if not isinstance(kind, kind_of):
            raise SceneError(f"a mixture needs pairs ({pair}), not {type(kind).__name__} as the first; {other}")
    return pairs
