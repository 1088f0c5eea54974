"""`vrte materials`: the ready materials, one line each, and a picture of their colours."""

import argparse
from pathlib import Path

from vrte.commands.common import (
    Parser,
    check_extra,
    check_output,
    make_whole_number_reader,
    say_written,
    show_progress,
)
from vrte.formats.materials import list_materials
from vrte.pictures.figures import SUFFIXES, save_figure
from vrte.render.colour import FEWEST, MOST


def add(command: Parser) -> None:
    """The arguments of `vrte materials`."""
    command.add_argument("-o", "--output", metavar="OUT.png", type=Path, help="a card of each; .svg and .pdf too")
    command.add_argument(
        "--wavelengths",
        metavar="N",
        type=make_whole_number_reader(FEWEST, MOST),
        default=FEWEST,
        help=f"from 0.4 to 0.7 um; default: {FEWEST}",
    )


def run(options: argparse.Namespace) -> None:
    if options.output:
        check_output(options.output, *SUFFIXES)
        check_extra(f"writing {options.output}", "render", ("colour", "matplotlib"))
    known = list_materials()
    width = max(map(len, known))
    for name, material in known.items():
        print(f"{name:{width}}  {material.description}")
    if not options.output:
        return
    from vrte.render.swatches import compute_card, draw_cards

    cards = []
    with show_progress() as (phase, tick):
        for name in known:
            phase(name)
            cards.append(compute_card(name, options.wavelengths, tick))
    save_figure(draw_cards(cards), options.output)
    say_written(options.output)
