"""From measurements back to materials: a paint, slabs, an aerosol; and the paint that hides at least cost.

``python -m docs.scripts.inversion -o FOLDER`` writes a table (CSV) and a picture of each task there, and inversion.md;
``--tasks slabs`` only some tasks, ``--runs 20`` fewer repetitions. Slabs need iadpython.
"""

import argparse
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bench.study import make_markdown_table, write_rows
from vrte.basics.arrays import Array
from vrte.basics.errors import IndistinguishableWarning
from vrte.calls.brdf import brdf
from vrte.fit import Fit, Measurement, fit
from vrte.formats.atomic import write_atomically
from vrte.formats.scene_family import SceneFamily
from vrte.optics.crowding import PERCUS_YEVICK, PackingWarning
from vrte.pictures.figures import require_pictures, save
from vrte.scene.boundary import Lambertian
from vrte.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NODES = 6  # in each hemisphere: within a tenth of the noise of a paint
HAZE_NODES = 16  # six miss polarization by 0.4 of its noise
SLAB_NODES = 16
RUNS = 100
WITHIN = 1.959964  # standard deviations, of 95 %
JOINTLY = 7.814728  # chi-square of three numbers, of 95 %
SIZE = "particles.rutile.size.lognormal.median_um"
PAINT_FREE = {  # where fits start, by up to twice off
    SIZE: {"start": 0.13, "low": 0.03, "high": 0.4, "spacing": "log"},
    "layer[2].volume_fractions.rutile": {"start": 0.03, "low": 0.005, "high": 0.3, "spacing": "log"},
    "layer[2].thickness_um": {"start": 6.0, "low": 0.5, "high": 50.0, "spacing": "log"},
}
PAINT_TRUE = np.array([0.1, 0.05, 4.0])
VIEWS_DEG = [-75.0, -60.0, -45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 60.0, 75.0]
SLABS = [  # albedo, thickness, g, index
    (0.9, 1.0, 0.5, 1.0),
    (0.9, 1.0, 0.5, 1.4),
    (0.9, 1.0, 0.5, 1.5),
    (0.99, 0.3, 0.0, 1.5),
    (0.99, 5.0, 0.8, 1.0),
    (0.99, 5.0, 0.8, 1.4),
    (0.99, 5.0, 0.8, 1.5),
]
AEROSOL = ("particles.haze.size.lognormal.median_um", "particles.haze.index")
ALL_OF_AEROSOL = (*AEROSOL, "particles.haze.size.lognormal.sigma", "layer[1].thickness")
PRICES = {"rutile": 12.0, "alkyd": 1.2}  # of a litre, in any money: what is best depends on their ratio alone
FIRST_TRIAL, TRIED = (0.08, 0.1), ((0.05, 0.25), (0.02, 0.4))  # median radius [um] and volume fraction
HIDDEN = 0.98  # of contrast ratio
WHITE = 0.8


def make_paint() -> dict[str, Any]:
    """A thin grey film on a white card, rutile and a weighed dose of black in alkyd, as a scene file's content."""
    rutile, thickness = PAINT_TRUE[1:].tolist()
    return {
        "wavelength_um": 0.55,
        "host_index": "alkyd",
        "particles": {
            "rutile": {"index": "rutile", "size": {"lognormal": {"median_um": float(PAINT_TRUE[0]), "sigma": 1.3}}},
            "black": {"index": [1.8, 0.7], "radius_um": 0.05},
        },
        "layer": [
            {"interface": {"above": 1.0, "below": "alkyd"}},
            {"volume_fractions": {"rutile": rutile, "black": 0.003}, "thickness_um": thickness},
        ],
        "base": {"kind": "lambertian", "albedo": WHITE},
    }


def make_goniometer() -> Measurement:
    """Reflectance factors and polarization at two incidences in the principal plane, to 0.002 each."""
    incidences, quantities = (20.0, 60.0), ("reflectance_factor", "minus_q_over_i")
    rows = [(name, theta_i, theta_o) for name in quantities for theta_i in incidences for theta_o in VIEWS_DEG]
    names, theta_i, theta_o = zip(*rows, strict=True)
    return Measurement(names, 0.0, 0.002, theta_i_deg=theta_i, theta_o_deg=theta_o)


@cache
def predict_paint() -> Array:
    """What the paint shows to the goniometer, (rows,)."""
    found: Array = make_goniometer().predict(make_paint(), nodes=NODES)
    return found


def add_noise(rows: Measurement, right: Array, seed: int) -> Measurement:
    """A measurement with normal noise of its sigma."""
    return rows.measure(right + rows.sigma * np.random.default_rng(seed).standard_normal(len(rows)))


def fit_paint(seed: int) -> Fit:
    """Size, loading and thickness from one noisy measurement."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IndistinguishableWarning)  # the page says how far they can be told apart
        return fit(add_noise(make_goniometer(), predict_paint(), seed), make_paint(), PAINT_FREE, nodes=NODES)


class Coverage(NamedTuple):
    """Of fits with other noise: deviations from the truth in standard deviations (run, n); their chi-squares, of the
    numbers and of their logarithms (run, 2); chi-squares of the rows (run,), and values and errors (run, n)."""

    deviations: Array
    jointly: Array
    chi2: Array
    values: Array
    errors: Array

    @property
    def within(self) -> Array:
        """How many runs have each number within 95 % errors, (n,)."""
        return (np.abs(self.deviations) <= WITHIN).sum(axis=0)

    @property
    def within_jointly(self) -> Array:
        """How many runs have the truth within the 95 % ellipsoid of the numbers, and of their logarithms, (2,)."""
        return (self.jointly <= JOINTLY).sum(axis=0)


def count_coverage(runs: int = RUNS, told: Callable[[str], None] = print) -> Coverage:
    """The paint fitted with noise of the seeds 0, 1, 2 and so on."""
    found = []
    for seed in range(runs):
        one = fit_paint(seed)
        off = one.values - PAINT_TRUE
        straight = np.log(one.values / PAINT_TRUE) * one.values
        jointly = [float(way @ np.linalg.solve(one.covariance, way)) for way in (off, straight)]
        found.append((off / one.errors, jointly, one.chi2, one.values, one.errors))
        if seed % 10 == 9:
            told(f"paint: {seed + 1} of {runs} fits")
    return Coverage(*(np.array(part) for part in zip(*found, strict=True)))


class Inverted(NamedTuple):
    """A slab: albedo, thickness, g and index; R and T at normal incidence as vrte finds them; albedo and thickness back
    by vrte and by iadpython."""

    slab: tuple[float, float, float, float]
    measured: Array
    ours: Array
    theirs: Array


def make_slab(albedo: float, thickness: float, g: float, index: float) -> dict[str, Any]:
    """A slab between surfaces of its own index, or of slides with it, in air; as a scene file's content."""
    layer = {"phase": {"henyey_greenstein": g} if g else "isotropic", "albedo": albedo, "thickness": thickness}
    if index == 1.0:
        return {"layer": [layer]}
    top, bottom = ({"interface": {"above": a, "below": b}} for a, b in ((1.0, index), (index, 1.0)))
    return {"layer": [top, layer, bottom]}


def fit_slab(slab: tuple[float, float, float, float], nodes: int = SLAB_NODES) -> tuple[Array, Array]:
    """R and T of a slab at normal incidence, and the albedo and thickness that vrte finds from them, g being known."""
    rows = Measurement(["total_reflectance", "total_transmittance"], 0.0, 1e-4, theta_i_deg=0.0)
    place = 1 if slab[3] == 1.0 else 2
    free = {
        f"layer[{place}].albedo": {"start": 0.8, "low": 0.1, "high": 1.0},
        f"layer[{place}].thickness": {"start": 2.0, "low": 0.01, "high": 100.0, "spacing": "log"},
    }
    right = rows.predict(make_slab(*slab), nodes=nodes)
    return right, fit(rows.measure(right), make_slab(*slab), free, nodes=nodes).values


def invert_slab(slab: tuple[float, float, float, float]) -> Inverted:
    """R and T of a slab back to its albedo and thickness by both codes."""
    import iadpython

    right, ours = fit_slab(slab)
    sample = iadpython.Sample(g=slab[2], n=slab[3], quad_pts=SLAB_NODES)
    measured = {"r": float(right[0]), "t": float(right[1])}
    theirs = iadpython.Experiment(**measured, sample=sample, default_g=slab[2]).invert_rt()
    return Inverted(slab, right, ours, np.array(theirs[:2], float))


def make_haze() -> dict[str, Any]:
    """A thin haze over a sea that is black, as a scene file's content."""
    size = {"lognormal": {"median_um": 0.15, "sigma": 1.5}}
    return {
        "wavelength_um": 0.55,
        "particles": {"haze": {"index": 1.45, "size": size}},
        "layer": [{"particles": "haze", "thickness": 0.01}],
    }


def fit_haze(names: Sequence[str] = AEROSOL, seed: int = 1) -> Fit:
    """Radius and index, or more, from -Q/I to 0.005 at 21 angles on both sides of the normal."""
    rows = Measurement("minus_q_over_i", 0.0, 0.005, theta_i_deg=50.0, theta_o_deg=np.linspace(-75.0, 75.0, 21))
    right = rows.predict(make_haze(), nodes=HAZE_NODES)
    ranges = {
        ALL_OF_AEROSOL[0]: {"start": 0.1, "low": 0.03, "high": 0.5, "spacing": "log"},
        ALL_OF_AEROSOL[1]: {"start": 1.55, "low": 1.2, "high": 1.8},
        ALL_OF_AEROSOL[2]: {"start": 1.5, "low": 1.1, "high": 2.5},
        ALL_OF_AEROSOL[3]: {"start": 0.03, "low": 0.001, "high": 0.5, "spacing": "log"},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IndistinguishableWarning)  # it is told by the result
        free = {name: ranges[name] for name in names}
        return fit(add_noise(rows, right, seed), make_haze(), free, nodes=HAZE_NODES)


@dataclass
class Hiding:
    """What a hidden square metre costs, by the median radius [um] and volume fraction of rutile in alkyd.

    ``solves`` counts scenes solved, ``optics`` how often particles were worked out anew, ``costs`` what was found.
    """

    solves: int = 0
    optics: int = 0
    costs: list[float] = field(default_factory=list)

    def find_cost(self, logarithms: Array, with_slopes: bool = True) -> tuple[float, Array]:
        """Cost at logarithms of radius and fraction, and its gradient by them: at constant hiding, by the rule of
        implicit functions, thickness goes by -(dC/dp) / (dC/dtau)."""
        values = np.exp(logarithms)
        self.optics += 1
        scene = self.family.at(values)
        (layer,), extinction = scene.layers, scene.thickness
        tau, variations = 10.0, self.family.variations(values) if with_slopes else []
        for _ in range(30):
            ratio, slopes = self.find_contrast(scene, layer, tau, [])
            step = (HIDDEN - ratio) / slopes[0]
            tau = max(tau + step, 0.5 * tau)
            if abs(step) < 1e-6 * tau:
                break
        price = PRICES["rutile"] * values[1] + PRICES["alkyd"] * (1.0 - values[1])  # of a litre of film
        cost = tau / extinction * price * 1e-3  # 1 um over a square metre is a millilitre
        self.costs.append(cost)
        if not with_slopes:
            return cost, np.zeros(0)
        still = [replace(one, thickness=0.0 * one.thickness) for one in variations]
        _, slopes = self.find_contrast(scene, layer, tau, still)
        thicker = -slopes[1:] / slopes[0]
        dearer = np.array([0.0, PRICES["rutile"] - PRICES["alkyd"]]) / price
        rates = np.array([one.thickness[0] for one in variations]) / extinction
        return cost, cost * (thicker / tau - rates + dearer) * values

    def find_contrast(self, scene: Scene, layer: Any, tau: float, more: list[Any]) -> tuple[float, Array]:
        """The contrast ratio over black and white at 45:0, and its derivatives by the thickness and by ``more``."""
        pieces: list[Any] = [*scene.interfaces[:1], replace(layer, thickness=tau)]
        logarithms, slopes = [], []
        for albedo in (0.0, WHITE):
            asked = [f"layer[{len(pieces)}].thickness", *more]
            stack = Scene(pieces, base=Lambertian(albedo))
            found = brdf(stack, np.sqrt(0.5), 1.0, nodes=NODES, derivatives=asked)
            self.solves += 1
            assert found.jacobian is not None
            there = found.mueller[0, 0, 0, 0, 0]
            logarithms.append(np.log(there))
            slopes.append(np.array([one[0, 0, 0, 0, 0] for one in found.jacobian.values()]) / there)
        ratio = float(np.exp(logarithms[0] - logarithms[1]))
        return ratio, ratio * (slopes[0] - slopes[1])

    @property
    def family(self) -> SceneFamily:
        """Scenes of 1 um of paint by radius and fraction."""
        return make_white_family()


@cache
def make_white_family() -> SceneFamily:
    """Scenes of 1 um of rutile in alkyd, by the radius and the volume fraction, crowded."""
    content = make_paint()
    del content["particles"]["black"], content["base"]
    content["layer"][1] = {"volume_fractions": {"rutile": 0.1}, "thickness_um": 1.0, "packing": PERCUS_YEVICK}
    return SceneFamily(content, [SIZE, "layer[2].volume_fractions.rutile"])


class Cheapest(NamedTuple):
    """A search's end: radius [um], fraction, cost, and what it took: evaluations, solves, seconds, costs on the way."""

    way: str
    radius_um: float
    fraction: float
    cost: float
    optics: int
    solves: int
    seconds: float
    costs: list[float]


def find_cheapest(with_slopes: bool) -> Cheapest:
    """The radius and fraction of least cost, by L-BFGS-B with gradients or with differences of costs."""
    from scipy.optimize import minimize

    hiding, began = Hiding(), time.perf_counter()
    find_least: Any = minimize
    how: dict[str, Any] = {"jac": True} if with_slopes else {"options": {"eps": 1e-4}}

    def find(logarithms: Array) -> Any:
        cost, slopes = hiding.find_cost(logarithms, with_slopes)
        return (cost, slopes) if with_slopes else cost

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PackingWarning)  # the page says where the packing ends
        found = find_least(find, np.log(FIRST_TRIAL), bounds=np.log(TRIED), method="L-BFGS-B", tol=1e-7, **how)
    radius, fraction = np.exp(found.x).tolist()
    way = "derivatives" if with_slopes else "differences"
    return Cheapest(way, radius, fraction, float(found.fun), hiding.optics, hiding.solves,
                    time.perf_counter() - began, hiding.costs)  # fmt: skip


Report = tuple[str, list[str], list[list[str]], Callable[["Axes"], None]]  # a title, a table's head and rows, a picture


def report_paint(runs: int) -> Report:
    """Coverage of the paint's error bars."""
    found = count_coverage(runs)
    rows = []
    for k, (name, true) in enumerate(zip(PAINT_FREE, PAINT_TRUE.tolist(), strict=True)):
        off = found.deviations[:, k]
        rows.append([name, f"{true:g}", f"{found.errors[:, k].mean() / true:.1%}",
                     f"{found.values[:, k].mean() / true - 1.0:+.1%}", f"{off.std(ddof=1):.2f}",
                     f"{found.within[k]} of {runs}"])  # fmt: skip
    for name, within in zip(("jointly", "jointly, logarithms"), found.within_jointly.tolist(), strict=True):
        rows.append([name, "", "", "", "", f"{within} of {runs}"])

    def draw(panel: "Axes") -> None:
        for k, label in enumerate(("size", "loading", "thickness")):
            share = (np.arange(runs) + 0.5) / runs
            panel.plot(np.sort(found.deviations[:, k]), share, label=label)
        grid = np.linspace(-3.5, 3.5, 141)
        from scipy.special import ndtr

        panel.plot(grid, ndtr(grid), ":", color="black", label="normal")
        panel.set(xlabel="deviation from the truth [standard errors]", ylabel="share of runs below")

    head = ["number", "true", "mean error bar", "mean deviation", "spread in error bars", "within 1.96"]
    return f"paint: {runs} runs", head, rows, draw


def report_slabs(runs: int) -> Report:
    """vrte and iadpython from the same R and T."""
    found = [invert_slab(one) for one in SLABS]
    rows = [
        [*(f"{one:g}" for one in slab), *(f"{one:.5f}" for one in measured),
         *(f"{a:.5f}, {b:.5f}" for a, b in (ours, theirs))]
        for slab, measured, ours, theirs in found
    ]  # fmt: skip

    def draw(panel: "Axes") -> None:
        for place, (label, right) in enumerate((("albedo", 0), ("thickness", 1))):
            off = [abs(one.theirs[right] / one.slab[right] - 1.0) for one in found]
            panel.semilogy(np.arange(len(found)) + 0.2 * place, off, "o", label=f"{label}, iadpython")
        ours = [max(abs(one.ours / one.slab[:2] - 1.0).max(), 1e-12) for one in found]
        panel.semilogy(ours, "k_", label="both, vrte")
        panel.set_xticks(range(len(found)), [f"n {one.slab[3]:g}\nb {one.slab[1]:g}" for one in found])
        panel.set(ylabel="relative error of the number found")

    return "slabs", ["albedo", "b", "g", "index", "R", "T", "vrte: albedo, b", "iadpython: albedo, b"], rows, draw


def report_aerosol(runs: int) -> Report:
    """Radius and index, alone and with what else may be unknown."""
    found = {count: fit_haze(ALL_OF_AEROSOL[:count]) for count in (2, 3, 4)}
    rows = []
    for one in found.values():
        for name, value, error in zip(one.names, one.values.tolist(), one.errors.tolist(), strict=True):
            rows.append([f"{len(one.names)}", name, f"{value:.4f}", f"{error:.4f}"])
        rows.append([f"{len(one.names)}", "least singular value", f"{one.singular_values.min():.1f}", ""])
        rows += [[f"{len(one.names)}", told, "", ""] for told in one.blind_spots]

    def draw(panel: "Axes") -> None:
        turn = np.linspace(0.0, 2.0 * np.pi, 100)
        for count, one in found.items():
            half = np.linalg.cholesky(one.covariance[:2, :2])
            around = one.values[:2, None] + half @ np.array([np.cos(turn), np.sin(turn)])
            panel.plot(*around, label=f"{count} unknown")
        panel.plot(0.15, 1.45, "k+", markersize=10, label="true")
        panel.set(xlabel="median radius [µm]", ylabel="index")

    return "aerosol", ["free", "number", "found", "error bar"], rows, draw


def report_hiding(runs: int) -> Report:
    """The cheapest hidden square metre."""
    found = [find_cheapest(one) for one in (True, False)]
    rows = [
        [one.way, f"{one.radius_um:.4f}", f"{one.fraction:.4f}", f"{one.cost:.6f}", f"{one.optics}", f"{one.solves}",
         f"{one.seconds:.0f}"]
        for one in found
    ]  # fmt: skip

    def draw(panel: "Axes") -> None:
        for one in found:
            best = np.minimum.accumulate(one.costs)
            panel.semilogy(np.arange(1, best.size + 1), best / best.min() - 1.0 + 1e-9, label=one.way)
        panel.set(xlabel="evaluations of the cost", ylabel="above the least cost, relative")

    head = ["gradient by", "radius [um]", "fraction", "cost of a m2", "evaluations", "solves", "seconds"]
    return "hiding", head, rows, draw


REPORTS = {"paint": report_paint, "slabs": report_slabs, "aerosol": report_aerosol, "hiding": report_hiding}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line: ``-o FOLDER``, ``--runs``, ``--tasks``."""
    parser = argparse.ArgumentParser(prog="python -m docs.scripts.inversion", description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("inversion"), help="folder to write to")
    parser.add_argument("--runs", type=int, default=RUNS, help="fits of the paint, each with other noise")
    parser.add_argument("--tasks", nargs="+", choices=list(REPORTS), default=list(REPORTS), help="which")
    options = parser.parse_args(arguments)
    require_pictures()
    from matplotlib.figure import Figure

    options.output.mkdir(parents=True, exist_ok=True)
    text = []
    for name in options.tasks:
        title, head, rows, draw = REPORTS[name](options.runs)
        drawing = Figure(figsize=(5.0, 3.8), facecolor="white", layout="constrained")
        panel = drawing.subplots()
        draw(panel)
        panel.set(title=title)
        panel.grid(color="#d0d0d0", linewidth=0.5)
        panel.legend(fontsize=8, frameon=False)
        save(drawing, options.output / f"inversion_{name}.png")
        write_rows(options.output / f"inversion_{name}.csv", head, rows)
        text.append(f"{title}\n\n{make_markdown_table(head, rows)}")
    with write_atomically(options.output / "inversion.md") as part:
        part.write_text("\n".join(text), encoding="utf-8")
    print("\n".join(text))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
