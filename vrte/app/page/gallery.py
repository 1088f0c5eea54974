"""Scenes and materials to begin with."""

import base64
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from vrte.app.form.content import Content
from vrte.app.form.files import adopt_content, begin_with_material, parse_content
from vrte.app.page.controls import add_heading
from vrte.formats.materials import ReadyMaterial, list_materials
from vrte.formats.paints import ReadyPaint, list_paints

Ready = ReadyMaterial | ReadyPaint
FOLDER = Path(__file__).parents[1] / "gallery"


def show_gallery(solve: Callable[[Content], Any], fill: Callable[[Content, tuple[str, ...]], Any]) -> None:
    """Offers scenes, to ``solve`` at once, and ready paints and materials, to ``fill`` the form with, beside the
    sentences about their approximations."""

    def solve_scene(path: Path) -> None:
        dialog.close()
        solve(adopt_content(parse_content(path.read_bytes())))

    with ui.dialog().props('aria-label="gallery"') as dialog, ui.card().classes("items-center vrte-gallery"):
        add_heading("Scenes to begin with", 2)
        with ui.row().classes("justify-center gap-1"):
            for path in sorted(FOLDER.glob("*.toml")):
                title = parse_content(path.read_bytes())["render"]["title"]
                with ui.button(on_click=partial(solve_scene, path)) as button:
                    button.props(f'flat no-caps aria-label="{title}"').classes("vrte-start")
                    picture = ui.element("img").props('alt="" width=84 height=84')
                    drawn = base64.b64encode(path.with_suffix(".png").read_bytes()).decode()
                    picture.props["src"] = f"data:image/png;base64,{drawn}"
                    ui.label(title)
        for title, known in (("Paints", list_paints()), ("Materials", list_materials())):
            add_heading(f"{title} to begin with", 2)
            with ui.row().classes("justify-center gap-1"):
                for one in known.values():
                    button = ui.button(one.title, on_click=lambda one=one: fill(*fill_with_material(one)))
                    button.on_click(dialog.close).props("flat no-caps dense").classes("px-2").tooltip(one.description)
    dialog.on("hide", dialog.delete)
    dialog.open()


def fill_with_material(material: Ready) -> tuple[Content, tuple[str, ...]]:
    """A scene of a ready material or paint, and what there is to tell of it."""
    told = (material.description, *material.approximations)
    return begin_with_material(material), tuple(text.rstrip(".") for text in told)


def list_paint_starts() -> dict[str, Callable[[], tuple[Content, tuple[str, ...]]]]:
    """What makes the scenes of paints, by their titles: of ready paints, and of films of materials."""
    films = [one for one in list_materials().values() if "thickness_um" in one.layer]
    known: list[Ready] = [*list_paints().values(), *films]
    return {one.title: partial(fill_with_material, one) for one in known}
