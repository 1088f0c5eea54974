"""A slab whose modes do not oscillate, by the compiled loops: what it does to all light, and how that changes with its
matrices E and F (core/slab_change.pxi). `SlabModes` does the same with modes of any kind."""

from copy import copy
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run
from vrte.discrete_ordinates.derivatives.slab import APART, DIM, Aside, Faces, measure_gaps, step_aside
from vrte.discrete_ordinates.orders.homogeneous import Modes
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.stages import select_read

RESPONSE = "nodes", "entering", "leaving", "passing"


class RealSlab:
    """Some orders of a slab by modes without an imaginary part; residual (order,)."""

    def __init__(
        self, one: Problem, matrices: Assembled, modes: Modes, material: int, thickness: float, run: Run
    ) -> None:
        """Of a problem's directions, made of one of its layers."""
        lam = modes.lam_re[:, material]
        self.run, self.one = run, one
        self.known: dict[str, Any] = vars(modes) | {"layer": material, "half": 0.5 * thickness}
        for name, mu, rows in (("in", one.mu0, one.n_rhs), ("out", one.mu_out, one.rows_out)):
            self.known |= lay_rays(name, mu, rows, lam, thickness)
        self.parts = 1 if np.isinf(thickness) else 6 if float(np.sqrt(lam.min())) * thickness > DIM else 2
        found = self.call("slab_by_modes", self.known)
        if found["info"].any():
            raise AccuracyError("a slab's system is singular")
        self.residual, self.nodes = found.pop("residual"), found.pop("nodes").swapaxes(-1, -2)
        self.known |= found
        self.point(one, matrices)

    def point(self, one: Problem, matrices: Assembled) -> None:
        """Finds what there is along the directions of a problem, which has these matrices."""
        self.known |= vars(matrices) | {"mu_out": one.mu_out, "stokes": len(one.stokes)}
        found = self.call("slab_along", self.known)
        self.along = [found.pop(name).swapaxes(-1, -2) for name in RESPONSE[1:]]
        self.known |= found

    def respond(self) -> list[Array]:
        """R and T on the nodes and along directions, as `Response` has them of a slab."""
        return [self.nodes, *self.along]

    def call(self, stage: str, known: dict[str, Any]) -> Any:
        """Arrays that a stage of the core finds, by their names in stages.toml."""
        with self.run.timed("derivatives") as crew:
            return getattr(_core, stage)(crew, **select_read(stage, known))

    def turn(self, beside: Problem, matrices: Assembled) -> "RealSlab":
        """The same slab with the directions of another problem, each near one of its own."""
        found = copy(self)
        found.one, found.known = beside, dict(self.known)
        for name, mu, own in (("in", beside.mu0, self.one.mu0), ("out", beside.mu_out, self.one.mu_out)):
            ratio = np.repeat(own / mu, len(beside.stokes))
            found.known[f"rate_{name}"] = self.known[f"rate_{name}"] * ratio[self.known[f"of_{name}"]]
        found.point(beside, matrices)
        return found

    def list_terms(self, light: Faces, weights: Faces) -> dict[str, Array]:
        """The parts of a derivative, for light that enters and what light that leaves weighs."""
        given = lay_faces(light, weights)
        given |= {"n_part": self.parts, "n_kind": min(self.parts, 3)}
        found: dict[str, Array] = self.call("slab_terms", self.known | given)
        return found

    def change(self, terms: dict[str, Array], matrices: Assembled) -> Array:
        """What weighs the light that a change of the first orders sends out, (order, r_weights, r); matrices of one
        layer, whose E and F are the change."""
        count = len(matrices.E)
        known = {name: part[:count] if isinstance(part, np.ndarray) else part for name, part in self.known.items()}
        own = {name: part[:count] for name, part in terms.items()}
        known |= own | vars(matrices) | {"mu_out": self.one.mu_out}
        found: Array = self.call("change_slab", known)
        return found.swapaxes(1, 2)

    def pull(self, terms: dict[str, Array], weights: Array) -> tuple[Array, Array]:
        """Derivatives with E and F of all that `change` finds, weighed by (order, r_weights, r): each by columns from
        nodes and beams to nodes and directions, (order, n + r, n + o)."""
        given: dict[str, Any] = {"pull_of_light": np.ascontiguousarray(weights.swapaxes(1, 2))}
        given |= {"n_in_rows": self.one.n_rhs, "n_out_rows": self.one.rows_out}
        found = self.call("pull_slab", self.known | terms | given)
        return found["pulled_E"], found["pulled_F"]


def lay_faces(light: Faces, weights: Faces) -> dict[str, Any]:
    """Light that enters a slab, and what weighs light that leaves it, by the core's names."""
    found = {"light_above": light.above, "light_below": light.below, "falling": light.falling, "rising": light.rising}
    found |= {"weight_above": weights.above, "weight_below": weights.below}
    found |= {"seen_falling": weights.falling, "seen_rising": weights.rising}
    return {name: np.ascontiguousarray(part.swapaxes(-1, -2)) for name, part in found.items()}


def lay_rays(name: str, mu: Array, rows: int, lam: Array, thickness: float) -> dict[str, Array | IntArray]:
    """By the core's names the rates of directions (d,) beside modes (order, n), each for its Stokes parameters, or six
    around one that is near a mode's."""
    stokes = rows // mu.size if mu.size else 1
    near = np.flatnonzero((measure_gaps(1.0 / mu, lam) < APART).any(axis=-1)) if mu.size else np.zeros(0, int)
    own: dict[int, Aside] = {order: step_aside(mu, lam[order], stokes, thickness) for order in near.tolist()}
    most = max([rows, *(aside.rate.size for aside in own.values())])
    rate, share = np.ones((len(lam), most)), np.ones((len(lam), most))
    of, used = np.zeros((len(lam), most), np.int32), np.full(len(lam), rows, np.int32)
    rate[:, :rows], of[:, :rows] = np.repeat(1.0 / mu, stokes), np.arange(rows)
    for order, aside in own.items():
        used[order] = count = aside.rate.size
        rate[order, :count], share[order, :count], of[order, :count] = aside.rate, aside.share, aside.of
    return {f"rate_{name}": rate, f"share_{name}": share, f"of_{name}": of, f"used_{name}": used}
