"""What a solve may leave out, each by its name: nothing of it changes the answer by more than was asked for."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SkipFlags:
    """All of it but in tests and in the table of what each saves (docs/explanation/plan.md).

    ``stokes``: Stokes parameters that an order keeps apart, or does not scatter; ``columns``: incident Stokes columns
    without light; ``orders``: Fourier orders of multiple scattering too faint to be seen; ``single``: orders of single
    scattering, in closed form; ``fluxes``: all but order 0, where fluxes alone are asked for; ``normal``: orders that
    the normal does not see; ``depth``: what lies below the light; ``clear``: eigenproblems without scattering;
    ``repeats``: equal layers; ``doublings``: those that change nothing; ``base``: orders that it does not reflect;
    ``azimuths``: mirror images; ``symmetric``: the general eigensolver; ``halves``: the other half of symmetric
    products; ``coarse``: fixed points on all nodes that those on every other one stand for.
    """

    stokes: bool = True
    columns: bool = True
    orders: bool = True
    single: bool = True
    fluxes: bool = True
    normal: bool = True
    depth: bool = True
    clear: bool = True
    repeats: bool = True
    doublings: bool = True
    base: bool = True
    azimuths: bool = True
    symmetric: bool = True
    halves: bool = True
    coarse: bool = True


EVERYTHING = SkipFlags()
