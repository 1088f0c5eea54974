"""Ready materials from Python: a layer of one, by its name."""

import math
from typing import Any

from vrte.basics.arrays import check_number
from vrte.basics.errors import SceneError
from vrte.scene.layer import Layer

ONE = "layer[1]."  # where a scene file would have it


def material(
    name: str,
    wavelength_um: float,
    *,
    thickness: float | None = None,
    thickness_um: float | None = None,
    volume_fraction: float | None = None,
    packing: str | None = None,
) -> Layer:
    """A layer of a ready material, as thick and as dense as it is typically, where nothing else is said.

    Parameters
    ----------
    name : str
        One of `vrte.materials()`, or the path of a file of one's own, "my_paint.toml" (docs/how_to/materials.md).
    wavelength_um : float
        In vacuum [um].
    thickness, thickness_um : float, optional
        Optical, or geometrical [um], in place of the typical one; powders and snow need volume_fraction with the
        latter.
    volume_fraction : float, optional
        Of all its particles together.
    packing : str, optional
        One of those of `Layer.of`, which docs/how_to/particles.md describes.

    Returns
    -------
    Layer
        In its host medium: above a resin belongs a `vrte.Interface` (docs/how_to/interfaces.md).

    Raises
    ------
    SceneError
        For an unknown name, a wavelength outside the tables of what it consists of, and what `Layer.of` refuses.

    Examples
    --------
    >>> import vrte
    >>> vrte.material("rutile in alkyd", 0.55).host_index
    1.52
    """
    from vrte.formats.scene_file import make_scene_file

    given: dict[str, Any] = {"thickness": thickness, "thickness_um": thickness_um, "volume_fraction": volume_fraction}
    layer: dict[str, Any] = {"material": name} | ({} if packing is None else {"packing": packing})
    for key, value in given.items():
        if value is not None:
            layer[key] = check_number(key, value, 0.0, math.inf, "a number >= 0")
    wavelength = check_number("wavelength_um", wavelength_um, 0.0, math.inf, "a length")
    content = {"wavelength_um": wavelength, "layer": [layer], "brdf": {"mu_i": 1.0, "mu_o": 1.0}}
    try:
        found: Layer = make_scene_file(content).scene.layers[0]
    except SceneError as error:
        raise SceneError(str(error).removeprefix(ONE), *error.place[2:]) from error
    return found
