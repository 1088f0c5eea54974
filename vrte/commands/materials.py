"""`vrte materials`: the ready materials, one line each, and a picture of their colours."""

import argparse

from vrte.commands.common import check_extra, show_progress, write
from vrte.formats.materials import list_materials
from vrte.pictures.figures import save_figure


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
