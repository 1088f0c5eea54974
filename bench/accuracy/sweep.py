"""Requested against achieved accuracy: every scene at every request, against a reference of its own."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench import cases
from vrte.basics.arrays import Array
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.scene.scene import Scene

MU = (0.02, 0.1, 0.35, 0.6, 0.85, 1.0)
PHI = (0.0, 30.0, 90.0, 150.0, 180.0)
GIVEN = tuple(10.0**-k for k in range(3, 12))
CHOSEN = tuple(10.0**-k for k in range(2, 10))
EXACT, CONTINUOUS = 1e-15, 1e-12  # accuracy of the references: on the same nodes, on many more
QUICK = ("Rayleigh, thickness 10", "HG 0.5", "spheroids", "gold powder, without end", "clear spheres, grazing")


@dataclass(frozen=True)
class Probe:
    """A scene, thin or thick, smooth or peaked, clear or absorbing, and what is asked of it: a BRDF between ``mu0``
    (n_in,) and MU, with the transmission where the layer ends, or, with ``tau``, the field of a polarized beam at those
    depths, up and down. ``nodes``: of the discrete problem; ``more``: two numbers of nodes that the continuous problem
    is taken from; ``of``: the name of the scene in `cases`, where that is not the probe's."""

    name: str
    nodes: int
    more: tuple[int, int]
    mu0: tuple[float, ...] = (0.2, 0.8)
    tau: tuple[float, ...] = ()
    of: str = ""

    @property
    def scene(self) -> Scene:
        """What is solved."""
        return cases.find_scene(self.of or self.name)

    @property
    def signed_mu(self) -> Array:
        """The cosines up and down."""
        return np.array([*MU, *(-mu for mu in MU)])


PROBES = {
    probe.name: probe
    for probe in (
        Probe("Rayleigh, thickness 0.01", 16, (160, 240)),
        Probe("Rayleigh, thickness 10, field", 16, (96, 128), (0.6,), (0.0, 5.0, 10.0), of="Rayleigh, thickness 10"),
        Probe("HG 0.5, thickness 1", 20, (96, 128)),
        Probe("HG 0.75, thickness 0.1", 41, (120, 160)),
        Probe("HG 0.85, without end", 72, (112, 144)),
        Probe("clear spheres, thickness 8", 24, (72, 96)),
        Probe("gold powder, thickness 100", 24, (72, 96)),
        Probe("gold powder, without end", 24, (72, 96)),
        Probe("spheroids, field", 16, (96, 128), (0.6,), (0.0, 0.2, 1.0), of="spheroids"),
        Probe("haze L, thickness 1", 50, (72, 96), (0.5,)),
        Probe("two layers over a base", 24, (72, 96)),
        Probe("absorbing spheroids, thickness 5", 16, (96, 128)),
        Probe("clear spheres, grazing beam", 24, (96, 128), (0.02, 0.05), of="clear spheres, thickness 2, over a base"),
        Probe(
            *("clear spheres, normal beam, field", 24, (160, 224), (1.0,), (0.0, 0.01, 1.0, 2.0)),
            of="clear spheres, thickness 2",
        ),
        Probe("water cloud, thickness 5", 24, (80, 104), (0.5,)),
        Probe("coarse pigment, thickness 10", 24, (72, 96)),
        Probe("peak below Rayleigh", 24, (112, 144)),
    )
}


@dataclass(frozen=True)
class Outcome:
    """One request: ``given``, whether its nodes were; nodes and unknowns (Stokes parameters and nodes of all orders)
    that it was solved with, orders; achieved, and what the reference is uncertain by; seconds; whether it was
    promised; ``saved``: whether fewer unknowns did than for the finest request."""

    scene: str
    given: bool
    requested: float
    achieved: float
    uncertain: float
    nodes: int
    orders: int
    unknowns: int
    seconds: float
    promised: bool
    saved: bool

    @property
    def slack(self) -> float:
        """Requested over achieved."""
        return self.requested / max(self.achieved, 1e-300)

    @property
    def kept(self) -> bool:
        """Whether no more was achieved amiss than was requested; NaN is not."""
        return self.achieved <= self.requested


@dataclass(frozen=True)
class Answer:
    """Light of each beam at each depth, (depth, beam, values), the largest I, (depth, beam), fluxes over pi, (depth,
    beam, up and down or one of them), and how they were found."""

    light: Array
    largest: Array
    flux: Array
    diagnostics: dict[str, Any]


def answer_probe(case: Probe, accuracy: float, nodes: int | None, algorithm: str = "auto") -> Answer:
    """What is asked of the case."""
    options: dict[str, Any] = {"accuracy": accuracy, "nodes": nodes, "algorithm": algorithm}
    if case.tau:
        field = radiance(case.scene, case.mu0[0], cases.POLARIZED, case.signed_mu, PHI, case.tau, **options)
        flux = np.stack([field.flux_up, field.flux_down], axis=-1)[:, None] / np.pi
        light = field.stokes[:, None]
        return Answer(light, np.abs(light[..., 0]).max(axis=(2, 3)), flux, field.diagnostics)
    ends = bool(np.isfinite(case.scene.thickness))
    found = brdf(case.scene, case.mu0, MU, PHI, transmission=ends, **options)
    matrices = [found.mueller] + ([] if found.transmission is None else [found.transmission])
    light = np.stack(matrices)
    # of the transmitted light no flux is told
    flux = np.stack([found.reflectance] + [np.zeros_like(found.reflectance)] * (len(matrices) - 1))[..., None] / np.pi
    return Answer(light, np.abs(light[..., 0, 0]).max(axis=(2, 3)), flux, found.diagnostics)


def measure_difference(one: Answer, other: Answer) -> float:
    """The largest of light and flux over pi, relative to the largest I of `other` at that depth for that beam."""
    light = np.abs(one.light - other.light).max(axis=tuple(range(2, one.light.ndim)))
    flux = np.abs(one.flux - other.flux).max(axis=2)
    return float((np.maximum(light, flux) / np.maximum(other.largest, 1e-290)).max())


def solve_references(case: Probe, given: bool) -> tuple[list[Answer], float]:
    """What is right, and how well it is known: by both algorithms on the nodes given, and what they differ by; or on
    many more nodes, and what still more of them differ by, which are taken."""
    if given:
        first, second = (answer_probe(case, EXACT, case.nodes, name) for name in ("modes", "doubling"))
        return [first, second], measure_difference(first, second)
    first, second = (answer_probe(case, CONTINUOUS, nodes) for nodes in case.more)
    return [second], measure_difference(first, second)


def measure_outcomes(names: Sequence[str], given: bool, requests: Sequence[float]) -> Iterator[Outcome]:
    """Every scene at every request; with nodes given those that carry all terms, the others have no accuracy."""
    for name in names:
        case = PROBES[name]
        if given and 2 * case.nodes < max(layer.phase_matrix.terms for layer in case.scene.layers):
            continue
        right, uncertain = solve_references(case, given)
        nodes = case.nodes if given else None
        finest = int(answer_probe(case, EXACT if given else min(requests), nodes).diagnostics["unknowns"])
        for requested in requests:
            found = answer_probe(case, requested, nodes)
            told = found.diagnostics
            yield Outcome(
                scene=name,
                given=given,
                requested=requested,
                achieved=max(measure_difference(found, answered) for answered in right),
                uncertain=uncertain,
                nodes=told["nodes"],
                orders=told["orders"],
                unknowns=int(told["unknowns"]),
                seconds=told["wall_seconds"],
                promised=told["promised"],
                saved=int(told["unknowns"]) < finest,
            )


def compute_median_slack(outcomes: Sequence[Outcome]) -> float:
    """Of requested over achieved, where a looser request did with less; NaN where none did."""
    saved = [outcome.slack for outcome in outcomes if outcome.saved]
    return float(np.median(saved)) if saved else float("nan")
