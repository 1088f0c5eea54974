"""`vrte export`: a scene file in, a file for renderers out, and how far it is off."""

import argparse
from typing import Any

from vrte.commands.common import report_written, show_progress
from vrte.commands.solve import HOW
from vrte.exports.export import export


def run(options: argparse.Namespace) -> None:
    asked: dict[str, Any] = {name: value for name in HOW if (value := getattr(options, name, None)) is not None}
    asked |= {"settings": dict(options.set)} if options.set else {}
    more = {name: getattr(options, name) for name in ("wavelengths_um", "step_deg", "nested", "diffuse")}
    with show_progress() as (phase, tick):
        phase("directions of the file")
        found = export(options.scene, options.output, progress=tick, **more, **asked)
    low, high = min(found.wavelengths_um), max(found.wavelengths_um)
    print(f"  {len(found.wavelengths_um)} wavelengths from {low:g} to {high:g} um\n  {found}")
    for note in found.notes:
        print(f"  {note}")
    for path in found.paths:
        report_written(path)
