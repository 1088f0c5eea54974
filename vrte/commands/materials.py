"""`vrte materials`: the ready materials, one line each, and a picture of their colours."""

import argparse

from vrte.commands.common import PICTURES, Parser, check_extra, show_progress, write
from vrte.formats.materials import list_materials
from vrte.pictures.figures import save_figure
from vrte.render.sky import FEWEST, MOST


def add(command: Parser) -> None:
    """The arguments of `vrte materials`."""
    command.take("-o --output OUT.png", "a card of each; .svg and .pdf too", suffixes=PICTURES)
    help_text = f"from 0.4 to 0.7 um; default: {FEWEST}"
    command.take("--wavelengths N", help_text, limits=(FEWEST, MOST), default=FEWEST)


def check(options: argparse.Namespace) -> None:
    """Whether colours can be computed. Raises MissingExtraError."""
    if options.output:
        check_extra(f"writing {options.output}", "render", ("colour", "matplotlib"))


def run(options: argparse.Namespace) -> None:
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
    write(options.output, lambda path: save_figure(draw_cards(cards), path))
