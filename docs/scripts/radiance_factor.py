"""Figures 1 and 2 of Budak and Efremenko, the radiance-factor paper: `python -m bench.report --figures`.

What the paper leaves open is settled here: its aerosol is Deirmendjian's haze L, both figures show the plane of
incidence, figure 2 the light that leaves the bottom.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench import cases
from bench.cases import FORWARD_PEAK, Slab, make_scene
from vrte.basics.arrays import Array
from vrte.calls.radiance import radiance
from vrte.pictures.figures import FAINT, require_pictures, save
from vrte.request.how import EXACT, METHODS
from vrte.results.field import Field
from vrte.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BEAM = 60.0  # [degrees] from the normal
INSIDE, SHARES = "haze L, thickness 10", (0.01, 0.25, 0.5, 0.75, 0.9)  # figure 1: where in the slab
LINES = ("#c62828", "#2e7d32", "#1565c0", "#ad1457", "#212121")
ALBEDO, THIN_AND_THICK = 0.99, (0.3, 2.0)  # figure 2, g = 0.9
COMPARED = {EXACT: "#212121", "small-angle": "#c62828", "single-scattering": "#1565c0"}
STEP = 1.0  # [degrees] between directions; none of them horizontal


@dataclass(frozen=True, eq=False)
class Lobe:
    """Radiance in the plane of incidence, (n,), over the angle of travel [degrees], (n,): from straight down, 0, over
    the beam's side, positive, to straight up, +-180."""

    angle: Array
    radiance: Array


def list_travel_angles() -> Array:
    """Angles of travel from straight down on the beam's side, without the horizontal: (n,) [degrees].

    >>> bool(np.any(list_travel_angles() == 90.0))
    False
    """
    return np.arange(0.5 * STEP, 180.0, STEP)


def join_half_circles(light: Array, angle: Array) -> Lobe:
    """Of light (n, 2) at phi 0 and 180: the second is the other side."""
    return Lobe(np.concatenate([-angle[::-1], angle]), np.concatenate([light[::-1, 1], light[:, 0]]))


def solve_inside() -> list[Lobe]:
    """Figure 1: the diffuse radiance at each of SHARES of the depth, for a beam of flux 1 across it."""
    angle = list_travel_angles()
    scene = cases.find_scene(INSIDE)
    field = solve_in_plane(scene, angle, [share * scene.thickness for share in SHARES], accuracy=1e-4)
    return [join_half_circles(light, angle) for light in field.stokes[..., 0]]


def solve_below(thickness: float) -> dict[str, Lobe]:
    """Figure 2: the diffuse radiance that leaves the bottom, by each method of COMPARED that is there."""
    scene = make_scene((Slab(FORWARD_PEAK, ALBEDO, thickness),))
    angle = list_travel_angles()
    angle = angle[angle < 90.0]
    fields = {name: solve_in_plane(scene, angle, [thickness], method=name) for name in COMPARED if name in METHODS}
    return {name: join_half_circles(field.stokes[0, ..., 0], angle) for name, field in fields.items()}


def solve_in_plane(scene: Scene, angle: Array, tau: list[float], **how: Any) -> Field:
    """The field of the beam at some depths, along angles of travel, on its side (phi 0) and on the other."""
    mu0, mu = np.cos(np.radians(BEAM)), -np.cos(np.radians(angle))
    return radiance(scene, mu0, mu=mu, phi=(0.0, 180.0), tau=tau, **how)


def draw_figure_1() -> "Figure":
    """Polar diagrams, each over its largest radiance."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 6.4), layout="constrained")
    panel: Any = figure.add_subplot(projection="polar")
    panel.set_theta_zero_location("S")  # straight down
    marks = range(0, 360, 45)
    panel.set_thetagrids(marks, [f"{angle if angle <= 180 else angle - 360}°" for angle in marks])
    panel.set_rlabel_position(157.5)  # where little light goes
    for lobe, share, colour in zip(solve_inside(), SHARES, LINES, strict=True):
        closed = [*range(lobe.angle.size), 0]
        size = lobe.radiance[closed] / lobe.radiance.max()
        panel.plot(np.radians(lobe.angle[closed]), size, color=colour, linewidth=1.3, label=f"{share:.0%} of the depth")
    panel.set_title(f"{INSIDE}, albedo 1, beam at {BEAM:g} degrees", fontsize=10)
    panel.grid(color=FAINT, linewidth=0.5)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def draw_figure_2() -> "Figure":
    """Radiance below, over the angle from straight down; a panel a thickness."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    panels: Any = figure.subplots(1, 2, sharey=True)
    for panel, thickness in zip(panels, THIN_AND_THICK, strict=True):
        for method, lobe in solve_below(thickness).items():
            panel.semilogy(
                lobe.angle, mask_negative_values(lobe.radiance), color=COMPARED[method], linewidth=1.2, label=method
            )
        panel.set_title(f"g = 0.9, albedo {ALBEDO:g}, thickness {thickness:g}", fontsize=10)
        panel.set_xlabel("angle from straight down [degrees]")
        panel.set_xticks(range(-90, 91, 30))
        panel.grid(color=FAINT, linewidth=0.5, alpha=0.7)
    panels[0].set_ylabel("radiance for a flux of 1 across the beam [1/sr]")
    panels[0].legend(fontsize=8, frameon=False)
    return figure


def mask_negative_values(values: Array) -> Array:
    """Gaps where an approximation is negative: a logarithmic axis has no place for that."""
    return np.where(values > 0.0, values, np.nan)


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes radiance_factor_1.png and radiance_factor_2.png into the folder after -o."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("radiance_factor"), help="folder to write to")
    folder = parser.parse_args(arguments).output
    require_pictures()
    folder.mkdir(parents=True, exist_ok=True)
    for number, draw in enumerate((draw_figure_1, draw_figure_2), 1):
        save(draw(), folder / f"radiance_factor_{number}.png")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
