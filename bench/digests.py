"""Digests of results: one line of hash a call, so that a change of the code shows whether a bit of a result moved.

python -m bench.digests record digests.json, then, after a change, python -m bench.digests check digests.json. Bits
depend on the machine and its libraries: a record holds on the machine where it was made. Everything runs on one thread.
"""

import argparse
import hashlib
import json
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import vrte
from vrte.request.how import EXACT, METHODS

MU_I, MU_O, PHI = [0.3, 0.9], [0.2, 0.6, 1.0], [0.0, 45.0, 180.0]


def particles() -> vrte.Particles:
    """Rutile in a binder, as coatings have it."""
    return vrte.spheres(2.7 + 0.001j, wavelength_um=0.55, size=vrte.Lognormal(0.12, 1.4), host_index=1.5)


def scene(base: Any = None, thickness: float = 1.0, albedo: float = 0.95) -> vrte.Scene:
    """Polarizing above depolarizing."""
    hg = vrte.henyey_greenstein(0.6, 24)
    upper = vrte.Layer(vrte.rayleigh(0.03), albedo=0.99, thickness=0.4)
    return vrte.Scene([upper, vrte.Layer(hg, albedo=albedo, thickness=thickness)], base)


def one_layer(thickness: float = 0.7, albedo: float = 0.9) -> vrte.Scene:
    """Rayleigh, no base."""
    return vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=albedo, thickness=thickness)])


def scalar(thickness: float = 2.0) -> vrte.Scene:
    """Henyey-Greenstein, no base."""
    return vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 16), albedo=0.8, thickness=thickness)])


def specular(mu_i: Any, mu_o: Any, phi: Any) -> Any:
    """A Mueller base: a lobe about the mirror's direction that polarizes a little."""
    lobe = 0.1 * np.exp(-4.0 * (mu_i - mu_o) ** 2) * (1.2 + np.cos(np.radians(phi)))
    found = np.zeros((*np.shape(lobe), 4, 4))
    for index, fraction in enumerate((1.0, 0.5, 0.5, 0.4)):
        found[..., index, index] = fraction * lobe
    found[..., 0, 1] = found[..., 1, 0] = 0.2 * lobe
    return found


def brdf(given: vrte.Scene, **how: Any) -> list[Any]:
    """Arrays of a BRDF."""
    found = vrte.brdf(given, MU_I, MU_O, PHI, threads=1, **how)
    return [found.mueller, found.reflectance, found.transmission, found.direct_transmittance]


def field(given: vrte.Scene, **how: Any) -> list[Any]:
    """Arrays of a field."""
    asked: dict[str, Any] = {"mu0": 0.6, "mu": [0.9, -0.4, 0.1], "phi": PHI, "tau": [0.0, 0.3, given.thickness]}
    found = vrte.radiance(given, **(asked | how), threads=1)
    return [found.stokes, found.flux_up, found.flux_down, found.direct]


def spectrum() -> list[Any]:
    """Of plain layers, at two wavelengths."""
    content = {"nodes": 6, "layer": [{"phase": "rayleigh", "albedo": 0.9, "thickness": 0.5}]}
    found = vrte.spectrum(content | {"brdf": {"mu_i": MU_I, "mu_o": MU_O}}, [0.45, 0.65], threads=1)
    return [found.mueller, found.reflectance]


def swept() -> list[Any]:
    """A small table of two axes."""
    layer = {"phase": "rayleigh", "albedo": 0.9, "thickness": 0.5}
    axes = {"layer[1].albedo": [0.5, 0.9], "layer[1].thickness": [0.2, 1.0]}
    content = {"nodes": 6, "layer": [layer], "brdf": {"mu_i": MU_I, "mu_o": MU_O, "phi_deg": PHI}, "axes": axes}
    table = vrte.sweep(content, workers=1)
    return [table["mueller"].values, table["reflectance"].values]


def calls() -> dict[str, Callable[[], list[Any]]]:
    """Every method, algorithm, backend, base, truncation; spectrum, sweep, fields, transmission, light from below."""
    lambertian, mueller = vrte.Lambertian(0.3), vrte.MuellerBase(specular)
    endless = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.98, thickness=np.inf)])
    endless_scalar = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.7, 32), albedo=0.9, thickness=np.inf)])
    powder = particles()
    peaked = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.9, 120), albedo=0.99, thickness=4.0)], lambertian)
    found: dict[str, Callable[[], list[Any]]] = {}
    for name, base in {"black": None, "Lambertian": lambertian, "Mueller": mueller}.items():
        found[f"brdf over {name}"] = lambda base=base: brdf(scene(base), nodes=8, transmission=True)
        found[f"field over {name}"] = lambda base=base: field(scene(base), nodes=8)
    for algorithm in ("auto", "direct", "modes", "doubling", "invariance"):
        found[f"algorithm {algorithm}"] = lambda name=algorithm: brdf(scene(lambertian), nodes=8, algorithm=name)
        found[f"algorithm {algorithm}, endless"] = lambda name=algorithm: brdf(endless, nodes=8, algorithm=name)
    for backend in ("openmp", "sequential", "sequential+device", "opencl+lapack", "opencl"):
        for name, base in {"black": None, "Lambertian": lambertian, "Mueller": mueller}.items():
            found[f"backend {backend} over {name}"] = lambda label=backend, base=base: brdf(
                scene(base), nodes=6, backend=label, transmission=True
            )
        found[f"backend {backend}, endless"] = lambda label=backend: brdf(endless, nodes=6, backend=label)
        found[f"backend {backend}, field"] = lambda label=backend: field(scene(lambertian), nodes=6, backend=label)
    for truncation in ("none", "delta-m", "small-angle", "auto"):
        found[f"truncation {truncation}"] = lambda name=truncation: brdf(peaked, nodes=16, truncation=name)
    for method in METHODS:
        if method == EXACT:
            continue
        many = method in ("adding-doubling", "matrix-operator", "single-scattering", "successive-orders")
        given = scene(None) if many else scalar()
        nodes = {} if method in ("diffusion", "monte-carlo", "two-stream") else {"nodes": 6}
        found[f"method {method}"] = lambda given=given, name=method, nodes=nodes: brdf(given, method=name, **nodes)
        found[f"method {method}, field"] = lambda given=given, name=method, nodes=nodes: field(
            given, method=name, tau=[0.0], mu=[0.9, 0.1], **nodes
        )
    found["method adding-doubling over Lambertian"] = lambda: brdf(scene(lambertian), method="adding-doubling")
    found["method matrix-operator over Lambertian"] = lambda: brdf(scene(lambertian), method="matrix-operator", nodes=6)
    found["method auto, thin"] = lambda: brdf(one_layer(1e-7), method="auto", accuracy=1e-3)
    found["method auto"] = lambda: brdf(one_layer(), method="auto", accuracy=1e-4)
    found["nodes chosen"] = lambda: brdf(one_layer(), accuracy=1e-5)
    found["nodes chosen, powder"] = lambda: brdf(vrte.Scene([vrte.Layer.of(powder, 2.0)], lambertian), accuracy=1e-3)
    found["powder"] = lambda: brdf(vrte.Scene([vrte.Layer.of(powder, np.inf)]), nodes=8)
    found["endless, scalar"] = lambda: brdf(endless_scalar, nodes=16)
    found["normal incidence"] = lambda: field(scene(lambertian), mu0=1.0, nodes=8)
    found["polarized light"] = lambda: field(scene(lambertian), stokes=[1.0, 0.3, 0.2, 0.5], nodes=8)
    found["polarized light, peaked"] = lambda: field(peaked, stokes=[1.0, 0.3, 0.2, 0.5], nodes=8, mu=None)
    found["several beams"] = lambda: field(scene(), mu0=[0.2, 0.6, 1.0], nodes=8)
    found["nodes as directions"] = lambda: field(scene(), mu=None, nodes=8)
    found["fluxes alone"] = lambda: field(scene(lambertian), mu=[], nodes=8)
    found["lit from the bottom"] = lambda: brdf(scene(), nodes=8, illuminate="bottom", transmission=True)
    found["field lit from the bottom"] = lambda: field(scene(), nodes=8, illuminate="bottom")
    found["verified"] = lambda: brdf(scene(lambertian), nodes=8, verify=True)
    found["conservative, thick"] = lambda: brdf(one_layer(1e4, 1.0), nodes=8)
    found["very thin"] = lambda: brdf(one_layer(1e-9, 1.0), nodes=8)
    found["particles"] = lambda: [powder.phase_matrix.a1, powder.phase_matrix.b1, np.array(powder.albedo)]
    for name, how in {"many scenes": {"threads": 1}, "many scenes, opencl": {"backend": "opencl"}}.items():
        found[name] = lambda how=how: [
            one.mueller for one in vrte.brdfs([one_layer(t) for t in (0.1, 0.7)], MU_I, MU_O, PHI, nodes=6, **how)
        ]
    found["views"] = lambda: [vrte.views(scene(), [0.3, 0.6], [0.2, 0.9], 30.0, nodes=8, threads=1).stokes]
    around = vrte.hemisphere(6)[0], MU_O, np.arange(0.0, 360.0, 10.0)
    found["under a sky"] = lambda: [vrte.brdf(scene(), *around, nodes=8, threads=1).under([1.0, 0.2, 0.0, 0.0])]
    found["spectrum"] = spectrum
    found["sweep"] = swept
    return found


def digest(arrays: list[Any]) -> str:
    """Of the bytes of all arrays, shapes included."""
    made = hashlib.sha256()
    for values in arrays:
        there = np.zeros(0) if values is None else np.ascontiguousarray(values)
        made.update(repr((there.shape, there.dtype.str)).encode() + there.tobytes())
    return made.hexdigest()


def main(arguments: list[str] | None = None) -> int:
    """Writes digests, or tells which differ from those written."""
    parser = argparse.ArgumentParser(prog="python -m bench.digests", description=__doc__)
    parser.add_argument("what", choices=["record", "check"])
    parser.add_argument("file", type=Path)
    options = parser.parse_args(arguments)
    found: dict[str, str] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, call in calls().items():
            try:
                found[name] = digest(call())
            except Exception as error:
                found[name] = f"{type(error).__name__}: {str(error).splitlines()[0][:150]}"
    if options.what == "record":
        options.file.write_text(json.dumps(found, indent=1) + "\n")
        print(f"{len(found)} digests in {options.file}")
        return 0
    before = json.loads(options.file.read_text())
    moved = [name for name in found if before.get(name) != found[name]]
    for name in moved:
        print(f"{name}: {before.get(name)} -> {found[name]}", file=sys.stderr)
    print(f"{len(found) - len(moved)} of {len(found)} as recorded")
    return 1 if moved else 0


if __name__ == "__main__":
    sys.exit(main())
