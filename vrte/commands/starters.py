"""Scene files to begin with, by what they are of: vrte/starters/KIND.toml."""

from pathlib import Path

FOLDER = Path(__file__).parents[1] / "starters"
KINDS = {  # by what is solved of them, and what they are
    "powder": ("brdf", "a thick gold powder in red light"),
    "paint": ("paint", "a white gloss paint on a black panel, at ten wavelengths"),
    "cloud": ("field", "a water cloud over the sea: the light above and below it"),
    "snow": ("brdf", "new snow with a little soot, from blue to infrared light"),
    "sea": ("brdf", "clear air over a rough sea: glint and polarized sky"),
}
