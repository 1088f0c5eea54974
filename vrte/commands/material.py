"""`vrte material`: refractive indices by name."""

import argparse
from typing import Any

from vrte.errors import SceneError
from vrte.optics.refractive_index import MATERIALS, refractive_index


def add(commands: Any) -> None:
    """`vrte material [NAME]`."""
    material = commands.add_parser("material", help="the refractive index of a material; without a name, all names")
    material.add_argument("name", nargs="?", help='a name, or a path in the database such as "main/Au/Johnson"')
    material.add_argument("--wavelength-um", type=float, metavar="UM", help="wavelength in vacuum [micrometres]")
    material.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    if options.name is None:
        for name, entry in MATERIALS.items():
            print(f"{name:12}{' and '.join(entry.pages)}: {entry.reason}")
        return
    if options.wavelength_um is None:
        raise SceneError("--wavelength-um is missing: an index depends on the wavelength")
    index = refractive_index(options.name, options.wavelength_um)
    print(f"{options.name} at {options.wavelength_um:g} um: n = {index.n:.6g}, k = {index.k:.6g}")
    print(f"from {index.source}")
