"""Which page of the documents says more: of a command, of a key of a scene file, of an error."""

from functools import cache
from importlib import metadata

from vrte.basics.errors import AccuracyError, DeviceError, MissingExtraError, SceneError, SweepError

SCENE_FILES = "reference/scene_files.md"
THIS = "reference/commands.md"  # of the commands themselves
OF_COMMANDS = {
    "init": SCENE_FILES,
    "brdf": SCENE_FILES,
    "field": SCENE_FILES,
    "sweep": "how_to/sweeps.md",
    "fit": "how_to/fitting.md",
    "view": "how_to/viewer.md",
    "render": "how_to/render.md",
    "material": "how_to/materials.md",
    "materials": "how_to/materials.md",
    "paint": "how_to/appearance.md",
    "phase": "how_to/importing.md",
    "devices": "how_to/opencl.md",
    "completion": THIS,
}
# of the steps of a SceneError's place, which may be an option's command, the last that is here
OF_KEYS = {
    **{name: OF_COMMANDS[name] for name in ("view", "material", "phase", "sweep", "render")},
    "mitsuba": "how_to/exports.md",
    **dict.fromkeys(
        ("wavelength_um", "host_index", "nodes", "accuracy", "title", "description", "layer", "brdf", "field"),
        SCENE_FILES,
    ),
    **dict.fromkeys(("particles", "size", "packing", "core", "shell", "source", "aspect_ratio"), "how_to/particles.md"),
    **dict.fromkeys(("index", "paint", "pigment", "binder"), "how_to/materials.md"),
    **dict.fromkeys(("table", "convention"), "how_to/importing.md"),
    **dict.fromkeys(("roughness", "distribution", "shadowing", "conserving"), "how_to/rough_surfaces.md"),
    **dict.fromkeys(("base", "substrate"), "how_to/bases.md"),
    **dict.fromkeys(("method", "settings"), "explanation/methods.md"),
    "axes": "how_to/sweeps.md",
    **dict.fromkeys(("fit", "free", "priors", "measurement", "resume"), "how_to/fitting.md"),
    "interface": "how_to/interfaces.md",
    "truncation": "explanation/truncation.md",
    "backend": "how_to/opencl.md",
    "appearance": "how_to/appearance.md",
}
OF_ERRORS: dict[type[BaseException], str] = {
    AccuracyError: "reference/stability.md",
    DeviceError: "how_to/opencl.md",
    MissingExtraError: "how_to/install.md",
    SweepError: "how_to/sweeps.md",
}


def find_page(error: BaseException) -> str | None:
    """The page that says more about what is wrong, as it is named to a user; None where none would help.

    >>> find_page(SceneError("layer[1].interface.roughness must be ...", "layer", 0, "interface", "roughness"))
    'docs/how_to/rough_surfaces.md'
    """
    if isinstance(error, SceneError):
        found = (OF_KEYS[step] for step in reversed(error.place) if step in OF_KEYS)
        page = next(found, None)
    else:
        page = OF_ERRORS.get(type(error))
    return page and locate_page(page)


def locate_page(page: str) -> str:
    """Where a page is read: on the site that the package's metadata name as Documentation, or in the source tree.

    >>> locate_page("how_to/sweeps.md")
    'docs/how_to/sweeps.md'
    """
    site = find_site()
    return f"{site}/{page.replace('README', 'index').removesuffix('.md')}.html" if site else f"docs/{page}"


@cache
def find_site() -> str:
    """The address of the documents on the web, "" where the package has none."""
    try:
        urls = metadata.metadata("vrte").get_all("Project-URL") or []
    except metadata.PackageNotFoundError:  # built in place and never installed
        return ""
    named = dict(url.split(", ", 1) for url in urls)
    return named.get("Documentation", "").rstrip("/")
