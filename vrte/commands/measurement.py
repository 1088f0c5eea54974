"""`vrte measurement`: what is understood of an instrument's file, what it leaves open, and its rows as vrte's table."""

import argparse
from contextlib import suppress
from typing import Any

import numpy as np

from vrte.basics.errors import SceneError
from vrte.commands.common import label_errors, write
from vrte.fit.instruments import KEYWORDS
from vrte.fit.measurement import make_measurement, understand_file


def read_pair(text: str) -> tuple[str, str]:
    """What a column is, and its name or number, of "wavelength_um=Wellenlänge"."""
    role, sign, name = text.partition("=")
    if not (role and sign and name):
        raise argparse.ArgumentTypeError(f"must be WHAT=COLUMN, not {text!r}")
    return role, name


def read_base(text: str) -> tuple[str, float]:
    """The name of a sample or a base, "" for all, and an albedo.

    >>> read_base("over white=0.8"), read_base("0")
    (('over white', 0.8), ('', 0.0))
    """
    name, _, albedo = text.rpartition("=")
    with suppress(ValueError):
        return name, float(albedo)
    raise argparse.ArgumentTypeError(f"must be ALBEDO or NAME=ALBEDO, not {text!r}")


def run(options: argparse.Namespace) -> None:
    given = {name: getattr(options, name) for name in KEYWORDS}
    given["columns"] = {role: int(name) if name.isdecimal() else name for role, name in options.columns} or None
    bases: Any = dict(options.base)
    given["base"] = bases.get("", bases or None)
    with label_errors(options.file, reading=True):
        reading = understand_file(options.file, given)
        print(reading)
        if reading.asks:
            flags = ", ".join(f"--{name.replace('_', '-').removesuffix('s')}" for name in reading.asks)
            raise SceneError(f"say what is missing by {flags}", *[*reading.asks][:1])
        measured = make_measurement(reading)
    for name in measured.names:
        value = measured.value[measured.quantity == name]
        print(f"{name}: {value.size} rows, {np.min(value):g} to {np.max(value):g}")
    write(options.output, lambda path: measured.save(path, "\n".join(reading.understood)))
