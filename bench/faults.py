"""Plants faults in a copy of the source, one at a time, and counts those that the quick tests catch.

`python -m bench.faults` takes the whole table, `--only NAME ...` some of it, `--list` names them. Each fault is first
shown to the test files that are meant to catch it, then, where these pass, to all quick tests. Tests that fail without
any fault are left out and named. A fault in the core is compiled, without optimization, in the copy.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LEFT = shutil.ignore_patterns(".git", ".venv*", ".*_cache", ".hypothesis", "out", "build", "dist", "__pycache__")
PYTEST = (sys.executable, "-m", "pytest", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider", "-rfE")
LONGEST = 1800  # seconds of a run of the tests: a fault that makes a loop endless is caught by the clock
PLANTED = "tests/test_house.py::test_faults_can_still_be_planted"  # fails with any fault


@dataclass(frozen=True)
class Fault:
    """``old`` stands once in ``file`` of vrte/; ``new`` in its place is wrong for the reason ``why``; ``tests``: files
    of tests/ that are meant to catch it."""

    name: str
    file: str
    old: str
    new: str
    why: str
    tests: str

    @property
    def is_compiled(self) -> bool:
        """Whether the core has to be built again."""
        return self.file.startswith("core/")


def list_faults(*rows: tuple[str, str, str, str, str, str]) -> tuple[Fault, ...]:
    return tuple(Fault(*row) for row in rows)


CORE = list_faults(
    ("givens", "core/moment_gmres.pxi", "c * b - cosines[2 * j + 1] * a", "c * b + cosines[2 * j + 1] * a",
     "sign of a rotation of GMRES", "iterations"),
    ("nodal-flux", "core/reconstruction.pxi", "+ r] = total - difference", "+ r] = total + difference",
     "flux that goes up is what goes down", "every_way"),
    ("resonant-gain", "core/gains.h", "small = x < 0.25 ? x : 0.25", "small = x < 0.2 ? x : 0.2",
     "the series of sinh(x)/x ends before the difference of exponentials begins", "stages"),
    ("mie-slope", "core/mie.pxi", "over(make(n + 1, 0.0), z)) - 1.0", "over(make(n + 1, 0.0), z)) + 1.0",
     "sign in the differential equation of Riccati-Bessel functions", "mie_derivatives"),
    ("facet-v", "core/facets.pxi", "d2 * re * c2, d2 * im", "d2 * re * c2, -d2 * im",
     "sign of U from V on facets of a metal", "facets rough"),
    ("flake-frame", "core/flakes.pxi", "g.between - 2.0 * g.sine_i", "g.between + 2.0 * g.sine_i",
     "sign of the plane of incidence in the frame of what flakes send out", "flakes"),
    ("flake-energy", "optics/flake_orders.py", "0, 0] += missing / weight", "0, 0] += 0.0 * missing / weight",
     "what quadrature misses of the energy of mirrors is left out", "flakes"),
    ("plate-retarder", "optics/flakes.py", "row[3, 2] = -weights @ (im * turn), weights @",
     "row[3, 2] = weights @ (im * turn), -weights @",
     "sign of U from V in light that passes plates", "plates"),
    ("doubling-end", "core/kernels/in_c.h", "DOUBLED 1e-9", "DOUBLED 1e-2",
     "doublings of a semi-infinite layer end too early", "every_way"),
    ("invariance-end", "core/kernels/steps.h", "gap * rate / (1.0 - rate) / largest", "gap * rate / largest",
     "the last step is taken for what all further steps change", "iterations"),
    ("mirrored", "core/single_scattering.pxi", "(k % 4 >= 2) == (s.kind", "(k % 4 >= 2) != (s.kind",
     "sign of U and V of light scattered once at azimuths beyond 180 degrees", "discrete_ordinates sums"),
    ("half-start", "core/invariance.pxi", "nodes[kind].H[k] - nodes[kind].phi[k]", "nodes[kind].H[k]",
     "fixed points begin from what is not R phi, and take as many steps as from 0", "iterations"),
    ("far-start", "core/invariance.pxi", "not gap <= NEAR * largest", "gap < 0.0",
     "fixed points go on from a start that is far from R, which may lead to another fixed point", "iterations"),
    ("under-invariance", "core/invariance.pxi", "share(&one, one.below, r, g, n, down, n)", "set_zero(nr, down)",
     "what a surface sends back down again is lost along the directions that are seen", "interfaces"),
    ("match-hiding", "fit/target.py", "(goal - value) / HIDING_SCALE", "(value - goal) / HIDING_SCALE",
     "films that hide too little meet a target", "match"),
    ("photon-turn", "core/photons.h", "m[2][j] = c2 * u - s2 * q;", "m[2][j] = s2 * q - c2 * u;",
     "sign of U where a photon's axis turns", "photons"),
    ("photon-view", "core/photons.h", "sine > 0.0 ? sn / sine : 0.0", "sine > 0.0 ? -sn / sine : 0.0",
     "sign of the azimuth that a photon is scattered to, along single directions", "photons"),
    ("photon-hidden", "core/photons.h", "kept = fmin(kept, seen) / seen;", "kept = 1.0;",
     "photons pass facets that hide them", "photons"),
)  # fmt: skip

DEVICE = list_faults(
    ("device-beam", "cl/doubling.cl", "ld + i] = -total;", "ld + i] = total;",
     "sign of the beam's source on a device", "engines"),
    ("device-argument", "cl/building.py", "sizes, found = read_declared()[name], d",
     "sizes, found = read_declared()[name][::-1], d",
     "arguments of a kernel in another order than it has them", "opencl_kernels"),
    ("device-memory", "cl/errors.py", "SHARE = 0.9", "SHARE = 90.0",
     "more than a device's memory is asked for", "opencl_device"),
)  # fmt: skip

ORDINATES = list_faults(
    ("share", "discrete_ordinates/planning/order_bounds.py", "\nSHARE = 0.1", "\nSHARE = 10.0",
     "layers that matter are left out", "plan"),
    ("kappa", "discrete_ordinates/planning/order_bounds.py", "DECAY * (1.0 - q), 0.0)", "1.8 * (1.0 - q), 0.0)",
     "light of an order decays faster than it can", "plan"),
    ("strongest", "discrete_ordinates/planning/choice.py", "STRONGEST = 0.98", "STRONGEST = 2.0",
     "invariance is given orders whose iterations converge slowly", "iterations"),
    ("thin", "discrete_ordinates/planning/choice.py", "\nTHIN = 1e-5", "\nTHIN = 0.0",
     "modes are given layers whose fluxes they lose digits of", "discrete_ordinates"),
    ("orders", "discrete_ordinates/planning/order_bounds.py", "ORDERS = 0.4", "ORDERS = 40.0",
     "orders that matter are left out", "plan accuracy"),
    ("safety", "discrete_ordinates/planning/order_bounds.py", "SAFETY = 3.0", "SAFETY = 0.01",
     "orders to come are taken for weaker than those that were seen", "plan accuracy"),
    ("weakened", "discrete_ordinates/execution/carry_out.py", "weakened = plan", "weakened = False and plan",
     "orders under a surface are compared with a beam that it has not weakened", "accuracy"),
    ("ways", "discrete_ordinates/planning/plan.py", "(np.concatenate(parts) for", "(parts[0] for",
     "orders below a surface are bounded along directions above it", "accuracy"),
    ("lowest-node", "discrete_ordinates/planning/choice.py", "SHARE_OF_STEEP = 0.3", "SHARE_OF_STEEP = 1e9",
     "modes are given nodes along which they lose digits", "discrete_ordinates"),
    ("base-sign", "discrete_ordinates/orders/base.py", "(FLIP[:, None] * orders)", "(1.0 * orders)",
     "sign of U and V that a base sends up", "discrete_ordinates"),
    ("graded-flux", "discrete_ordinates/orders/phase_assembly.py", "and not problem.is_exact:", "and problem.is_exact:",
     "nodes that are not Gauss's lose flux", "energy_balance every_way"),
    ("gmres", "discrete_ordinates/orders/tanh_poles.py", 'of_scatterings": 1e-9', 'of_scatterings": 1e9',
     "moments that do not satisfy their equation are taken", "iterations"),
    ("residual", "discrete_ordinates/orders/modes.py", '"residual_of_modes": 1e-9,', '"residual_of_modes": 1e9,',
     "modes that do not solve their equation are taken", "discrete_ordinates"),
    ("radiance-index", "discrete_ordinates/execution/through_interfaces.py",
     "vertex.escapes[level, rows] * sights.index[level] ** 2", "vertex.escapes[level, rows] * sights.index[level]",
     "radiance over index^2 is what a ray keeps", "every_way"),
    ("small-angle", "discrete_ordinates/orders/small_angle.py",
     "(1.0 - layer.albedo * f) * mu0", "(1.0 + layer.albedo * f) * mu0",
     "sign in the depth of layers without their forward peak", "truncation"),
    ("divided-thin", "core/derivatives.pxi", "double THIN = 0.5", "double THIN = 0.0",
     "differences of nearly equal numbers are divided", "derivatives"),
    ("derivative-net", "discrete_ordinates/derivatives/slab_stack.py", "\nALLOWED = 1e-9", "\nALLOWED = 1e9",
     "derivatives by modes without digits are taken", "derivatives_api"),
    ("moved-nodes", "discrete_ordinates/derivatives/slab_stack.py",
     "nodes=other.problem.nodes, weights=other.problem.weights", "nodes=one.nodes, weights=one.weights",
     "nodes stay where they are as a refractive index moves them", "derivatives"),
)  # fmt: skip

METHODS = list_faults(
    ("semi-infinite", "methods/parts/slab.py", "CONVERGED = 1e-15", "CONVERGED = 1e-5",
     "the reflection of a semi-infinite layer has not converged", "methods_by_theory"),
    ("steep", "methods/parts/slab.py", "STEEP = 8.0", "STEEP = 0.01",
     "a recurrence is used where it loses digits", "methods_by_theory"),
    ("join-residual", "methods/parts/slab.py", "LARGEST_RESIDUAL = 1e-6", "LARGEST_RESIDUAL = 1e6",
     "slabs joined by a singular system are taken", "methods_by_theory"),
    ("white-flux", "methods/slabs.py", "balance_flux(slab) if conserves", "slab if conserves",
     "white slabs lose what the starting layer misses", "methods_by_theory"),
    ("diffusion-base", "methods/two_fluxes.py", "2.0 * albedo / c)", "albedo / c)",
     "factor of the light that a base sends out under diffusion", "methods_by_theory"),
    ("diffusion-flux", "methods/synthetic_iteration.py", "(down - up)[:-1]", "(up - down)[:-1]",
     "sign of the net flux in the regular part", "methods_by_theory"),
    ("synthetic-flip", "methods/synthetic_iteration.py", "*= problem.flip[:, None, None]", "*= 1.0",
     "sign of U and V of light that goes up", "methods_by_theory"),
)  # fmt: skip

OTHERS = list_faults(
    ("fresnel-v", "optics/fresnel.py", "= elements[..., 3], -elements[..., 3]", "= -elements[..., 3], elements[..., 3]",
     "sign of V of light reflected by a metal, or totally", "interfaces optics"),
    ("delta-m", "optics/truncation.py", "stretch, albedo / stretch)", "stretch, albedo)",
     "light scattered once by all terms lacks the factor of the TMS method", "truncation"),
    ("coherent-sign", "scene/backscattering.py", "[-1, 1, 1, 1]", "[1, 1, 1, 1]",
     "sign of U's amplitudes in paths that are reversed", "backscattering"),
    ("base-energy", "scene/boundary.py", "ENERGY_ALLOWED = 1e-3", "ENERGY_ALLOWED = 1e3",
     "a base may give back more than it gets", "refused"),
    ("azimuth-sign", "scene/azimuths.py", "[[0.0, -1.0], [1.0, 0.0]]", "[[0.0, 1.0], [1.0, 0.0]]",
     "sign of sin(m phi) in a base's Fourier orders", "bases"),
    ("beam-energy", "calls/energy.py", "beams[:, :, 1] - beams[:, :, 0]", "beams[:, :, 1] + beams[:, :, 0]",
     "sign of beams that go up in the balance of light", "energy_balance"),
    ("per-mass", "formats/scattering.py", "PER_MASS = 1e-3", "PER_MASS = 1.0",
     "unit of coefficients for a mass", "scattering_tables"),
    ("seal", "formats/atomic.py", "if first != COMMENT + make_seal(rest)", "if not first",
     "tables of results that were changed are read", "foreign_files"),
    ("unlikely", "fit/verdict.py", "UNLIKELY = 0.01", "UNLIKELY = 1e-9",
     "models that do not fit are said to fit", "fit"),
    ("hiding", "appearance/hiding.py", "\nCLOSE = 1e-3", "\nCLOSE = 0.3",
     "the search for the hiding thickness ends too early", "appearance_hiding"),
    ("stale-slopes", "fit/problem.py", "if self.updates and not", "if self.updates > 10**9 and not",
     "derivatives that lead nowhere are never found anew", "fit"),
    ("either-unit", "fit/instruments.py", "if largest >= 100.0 * darkest and", "if largest >= 1e9 * darkest and",
     "values that may be per cent or fractions are guessed in silence", "instruments"),
    ("two-tables", "formats/instrument_files.py", "(lines[index][2]) == width:", "(lines[index][2]) > width:",
     "a second table in a file is left out in silence", "instruments"),
)  # fmt: skip

FAULTS = CORE + DEVICE + ORDINATES + METHODS + OTHERS


class Copy:
    """A copy of the source in ``folder``, where faults are planted and tests run."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.red = folder, {PLANTED}
        shutil.copytree(ROOT, folder, ignore=LEFT)
        setup = folder / "setup.py"
        setup.write_text(setup.read_text().replace('"-O3"', '"-O0"'))
        self.core = {path: path.read_bytes() for path in (folder / "vrte").glob("_core.*") if path.suffix != ".pyx"}

    def run(self, command: Sequence[str], check: bool = False) -> tuple[int, str]:
        """The exit code and the output of a command in the copy; 1 where it takes too long."""
        environment = os.environ | {"PYTHONPATH": str(self.folder)}
        try:
            done = subprocess.run(
                command, cwd=self.folder, env=environment, timeout=LONGEST, stdout=-1, stderr=-2, text=True, check=check
            )
        except subprocess.TimeoutExpired:
            return 1, f"FAILED by the clock: {LONGEST} s"
        return done.returncode, done.stdout

    def find_failures(self, tests: Sequence[str], first: bool = True) -> list[str]:
        """The tests that fail among files, or all quick ones for none; the first one alone, or all."""
        how = ["-x"] if first and tests else ["-x", "-n", "2"] if first else ["-n", "2"]
        without = (f"--{'deselect' if '::' in test else 'ignore'}={test}" for test in sorted(self.red))
        code, output = self.run([*PYTEST, *how, *without, *tests])
        failed = re.findall(r"^(?:FAILED|ERROR) (.*?)(?: - .*)?$", output, re.MULTILINE)
        if code not in (0, 1, 2) or (code and not failed):
            raise SystemExit(f"pytest ended with {code}:\n{output[-2000:]}")
        return failed

    def plant(self, fault: Fault) -> str:
        """Puts the fault in, and compiles it where it is one of the core; the file's text as it was. Raises SystemExit
        where the old text does not stand once in the file."""
        path = self.folder / "vrte" / fault.file
        text = path.read_text()
        if text.count(fault.old) != 1:
            raise SystemExit(f"{fault.name}: {fault.old!r} stands {text.count(fault.old)} times in vrte/{fault.file}")
        path.write_text(text.replace(fault.old, fault.new))
        if fault.is_compiled:
            self.run([sys.executable, "setup.py", "-q", "build_ext", "--inplace", "--force"], check=True)
        return text

    def restore(self, fault: Fault, text: str) -> None:
        (self.folder / "vrte" / fault.file).write_text(text)
        for path, content in self.core.items() if fault.is_compiled else ():
            path.write_bytes(content)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.faults", description=__doc__.split("\n\n")[0])
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=[fault.name for fault in FAULTS], default=())
    parser.add_argument("--list", action="store_true", help="names the faults")
    parser.add_argument("--named", action="store_true", help="runs the named test files alone, not all quick tests")
    asked = parser.parse_args()
    chosen = [fault for fault in FAULTS if not asked.only or fault.name in asked.only]
    if asked.list:
        print(*(f"{fault.name:20} {fault.file}: {fault.why}" for fault in chosen), sep="\n")
        return 0
    missed = []
    with tempfile.TemporaryDirectory(prefix="vrte-faults-") as folder:
        copy, whole = Copy(Path(folder) / "vrte"), False
        named = {fault: [f"tests/test_{name}.py" for name in fault.tests.split()] for fault in chosen}
        copy.red |= {*copy.find_failures(sorted({file for files in named.values() for file in files}), first=False)}
        print("".join(f"fails without a fault: {test}\n" for test in sorted(copy.red - {PLANTED})), end="", flush=True)
        for fault in chosen:
            begin, text = time.monotonic(), copy.plant(fault)
            failed = copy.find_failures(named[fault])
            if not failed and not asked.named:
                if not whole:
                    copy.restore(fault, text)
                    copy.red |= {*copy.find_failures((), first=False)}
                    whole, text = True, copy.plant(fault)
                failed = copy.find_failures(())
            copy.restore(fault, text)
            missed += [] if failed else [fault.name]
            verdict = f"caught by {failed[0]}" if failed else f"MISSED: {fault.why}"
            print(f"{fault.name:20} {verdict} ({time.monotonic() - begin:.0f} s)", flush=True)
    print(f"{len(chosen) - len(missed)} of {len(chosen)} caught; missed: {', '.join(missed) or 'none'}")
    return bool(missed)


if __name__ == "__main__":
    sys.exit(main())
