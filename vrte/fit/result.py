"""vrte.Fit: the numbers of a scene that a measurement tells, and how well."""

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, make_readonly, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress
from vrte.basics.views import Figure, view
from vrte.fit.measurement import Measurement
from vrte.fit.problem import FitProblem
from vrte.fit.verdict import Profile, find_correlations, find_profile
from vrte.formats.scene_file import write_content
from vrte.scene.scene import Scene

ARRAYS = ("values", "errors", "covariance", "predicted", "sigma", "slopes", "singular_values")


@dataclass(frozen=True)
class Start:
    """Where a fit began, what it found, chi2 at the end, how many solves it took, and why it ended."""

    values: tuple[float, ...]
    found: tuple[float, ...]
    chi2: float
    solves: int
    ended: str


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """What `vrte.fit` found: numbers of a scene, their errors, and how they came about. All arrays are read-only.

    ``fitted`` in the examples is what the example of `vrte.fit` finds.

    Attributes
    ----------
    names
        The free numbers, n.
    values
        Where they fit best, (n,).
    errors
        One standard deviation of each, (n,): the root of the covariance's diagonal, from the derivatives at the best.
    covariance
        (n, n); inf where the data do not tell a number at all.
    measurement
        What was measured, (rows,) in its columns.
    predicted
        What the scene shows with ``values``, (rows,).
    sigma
        Standard deviations that counted, (rows,): the measurement's, or where it has none such that the reduced
        chi-square is 1.
    slopes
        Derivatives of ``predicted``, (rows, n).
    chi2
        Sum of squares of ``residuals`` and of the priors' in their standard deviations, with the measurement's sigma;
        without it, with one that is the root mean square of each quantity.
    degrees_of_freedom
        Rows and priors less free numbers.
    p_value
        The chance of a chi2 as large where the model is right and sigma is; NaN without sigma or degrees of freedom.
    error_scale
        By what errors are larger than sigma and priors say: 1, or where the chance is below 1 % the root of chi2 over
        the degrees of freedom; covariance and profiles with it.
    singular_values
        Of the derivatives in sigmas by relative changes, (n,): a direction whose singular value is s is known to 1/s.
    blind_spots
        What the data cannot tell, in sentences.
    notes
        What else is to be known: bounds that were reached, errors that were scaled, nodes.
    starts
        All starts, the best first.
    nodes
        Nodes in each hemisphere of all solves.
    interrupted
        Whether it was stopped before it had converged.
    problem
        Model, free numbers and priors, for what is asked of the fit later; None where it was read from a file.

    Examples
    --------
    >>> fitted.names
    ('layer[1].thickness',)
    """

    names: tuple[str, ...]
    values: Array
    errors: Array
    covariance: Array
    measurement: Measurement
    predicted: Array
    sigma: Array
    slopes: Array
    chi2: float
    degrees_of_freedom: int
    p_value: float
    error_scale: float
    singular_values: Array
    blind_spots: tuple[str, ...]
    notes: tuple[str, ...]
    starts: tuple[Start, ...]
    nodes: int | None
    interrupted: bool = False
    problem: FitProblem | None = None

    def __post_init__(self) -> None:
        for name in ARRAYS:
            object.__setattr__(self, name, make_readonly(np.array(getattr(self, name), float)))

    @property
    def correlations(self) -> Array:
        """Correlations of the errors of the fitted numbers, (n, n)."""
        return find_correlations(self.covariance)

    @property
    def measured(self) -> Array:
        """The values that were measured, (rows,)."""
        return self.measurement.value

    @property
    def residuals(self) -> Array:
        """Measured less predicted in sigmas, (rows,)."""
        return (self.measured - self.predicted) / self.sigma

    @property
    def reduced_chi2(self) -> float:
        """chi2 over the degrees of freedom; NaN where there are none."""
        return self.chi2 / self.degrees_of_freedom if self.degrees_of_freedom else float("nan")

    def __repr__(self) -> str:
        pairs = ", ".join(f"{name} = {text}" for name, text in self._list_numbers())
        return f"Fit({pairs}{', interrupted' if self.interrupted else ''})"

    def __str__(self) -> str:
        head = f"{len(self.names)} numbers from {len(self.measurement)} rows, chi2 {self.chi2:.4g}"
        chance = f" (p {self.p_value:.2g})" if self.p_value == self.p_value else ""
        lines = [f"{head} with {self.degrees_of_freedom} degrees of freedom{chance}"]
        width = max(map(len, self.names))
        lines += [f"  {name:{width}}  {text}" for name, text in self._list_numbers()]
        return "\n".join([*lines, *(f"  {one}" for one in (*self.blind_spots, *self.notes))])

    def _list_numbers(self) -> list[tuple[str, str]]:
        """Names, and values with errors as they are written."""
        pairs = zip(self.names, self.values.tolist(), self.errors.tolist(), strict=True)
        return [(name, f"{value:.6g} +- {error:.2g}") for name, value, error in pairs]

    def profile(self, name: str, values: Any = None, points: int = 9, progress: Progress | None = None) -> Profile:
        """The rise of chi2 along one number, all others fitted anew, at ``values``, by default so many ``points`` (3 at
        least) to three standard deviations on either side; ``progress`` gets (values done, values)."""
        return find_profile(self, name, values, points, progress)

    def plot(self) -> Figure:
        """A column of two panels for each quantity, up to four, with measured and fitted values and residuals in
        sigmas; and how the residuals are spread."""
        return view(self, "plot")

    def page(self, path: str | os.PathLike[str]) -> None:
        """Writes all of it as a page (.html), one file that opens without a network."""
        view(self, "page", path)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the fit to a file (.json) that `load` brings back; without its scene where that was a `vrte.Scene`."""
        from vrte.fit.files import save_fit

        if not os.fspath(path).lower().endswith(".json"):
            raise SceneError(f"the fit {put_in_one_line(os.fspath(path))} must end in .json")
        save_fit(self, path)

    @staticmethod
    def load(path: str | os.PathLike[str], folder: str | os.PathLike[str] | None = None) -> "Fit":
        """A fit from the file that `save` wrote; tables that its scene names lie in ``folder``, or beside the file."""
        from vrte.fit.files import load_fit

        return load_fit(path, folder)

    def scene(self, wavelength_um: float | None = None) -> Scene:
        """The scene that fits best at one of the measurement's wavelengths [um], by default its own or the first;
        over the first of the measurement's bases, where rows have some."""
        known = self.find_problem().model.families
        families = {wavelength: known[wavelength, base] for wavelength, base in reversed([*known])}
        wanted = next(iter(known))[0] if wavelength_um is None else float(wavelength_um)
        if wanted not in families:
            allowed = ", ".join(f"{one:g}" for one in reversed(families) if one is not None) or "only the scene's own"
            raise SceneError.of("wavelength_um", f"must be one of the fit's, {allowed}, not {wavelength_um}")
        return families[wanted].at(np.array(self.values))

    def write_scene(self, path: str | os.PathLike[str]) -> None:
        """Writes the scene file (.toml) with ``values`` in it, otherwise as it was but for comments."""
        write_content(self.content(), path)

    def content(self) -> dict[str, Any]:
        """The content of the scene file with ``values`` in it, as TOML has it."""
        family = self.find_problem().model.source
        if isinstance(family.source, Scene):
            raise SceneError("a vrte.Scene was fitted, of which there is no scene file: take its scene()")
        return family.content_at(np.array(self.values))

    def find_problem(self) -> FitProblem:
        """Model, free numbers and priors, for what is asked of the fit later."""
        if self.problem is None:
            raise SceneError("this fit was read from a file that does not hold its scene")
        return self.problem
