"""A scene file of Mitsuba 3 (XML) in which its own polarized dielectric lies on a table of what is below it.

Mitsuba has no sum of BSDFs (blendbsdf mixes up beams and other light), so the surface is a shape of its own: Mitsuba
follows the light through it, and up and down between the two as often as it goes.
"""

from html import escape
from pathlib import Path

from vrte.formats.atomic import PathName, write_atomically

GAP = 5e-4  # of two spheres of radius 1: rays start 1.8e-4 off what they leave; angles change by its square root
TEMPLATE = """\
<scene version="3.0.0">
    <!-- Light from emitters that rays can hit; integrator: path, in stokes, with max_depth -1. The two shapes may be
         others, one a little inside the other: the gap is filled with the medium below the surface. -->
    <bsdf type="dielectric" id="surface">
        <float name="ext_ior" value="{above!r}"/>
        <float name="int_ior" value="{below!r}"/>
    </bsdf>
    <bsdf type="measured_polarized" id="below_surface">
        <string name="filename" value={table}/>
        <float name="alpha_sample" value="1.0"/>
    </bsdf>
    <shape type="sphere">
        <ref id="surface"/>
    </shape>
    <shape type="sphere">
        <float name="radius" value="{inside!r}"/>
        <ref id="below_surface"/>
    </shape>
</scene>
"""


def write_nested_scene(path: PathName, table: PathName, index_above: float, index_below: float) -> None:
    """Writes a sphere of the table ``table``, which must lie beside ``path``, in one of a smooth dielectric. Raises
    OSError."""
    name = f'"{escape(Path(table).name)}"'
    text = TEMPLATE.format(above=index_above, below=index_below, table=name, inside=1.0 - GAP)
    with write_atomically(path) as part:
        Path(part).write_text(text, encoding="utf-8")
