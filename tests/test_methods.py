"""One body of tests over all methods beside the exact one."""

import numpy as np
import pytest

import vrte
from vrte.errors import SceneError
from vrte.methods import method_of
from vrte.methods.method import Method
from vrte.request import EXACT, METHODS

OTHERS = tuple(name for name in METHODS if name != EXACT)
MU, PHI = np.array([0.3, 0.8]), np.array([0.0, 40.0, 180.0])


@pytest.fixture(params=OTHERS)
def method(request: pytest.FixtureRequest) -> Method:
    """Every one of them."""
    return method_of(request.param)


def test_what_it_says_of_itself(method: Method) -> None:
    assert method.name in METHODS
    assert method.purpose
    assert method.conserves
    assert "(2:" in method.source or "(1:" in method.source
    for name, setting in method.settings.items():
        assert setting.meaning
        assert setting.checked(setting.default) == setting.default, name


def test_unknown_settings_are_refused(method: Method) -> None:
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 1.0)])
    with pytest.raises(SceneError, match=f"method '{method.name}' has no setting 'nonsense'"):
        vrte.brdf(scene, MU, MU, method=method.name, settings={"nonsense": 1})


def test_what_it_does_not_take_is_refused(method: Method) -> None:
    layer = vrte.Layer(vrte.isotropic(), 0.9, 1.0)
    cases = {
        "polarization": (vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]), "phase matrix that polarizes"),
        "layers": (vrte.Scene([layer, layer]), "pile of several layers"),
        "base": (vrte.Scene([layer], vrte.Lambertian(0.5)), "base"),
        "endless": (vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, np.inf)]), "layer without end"),
    }
    for ability, (scene, words) in cases.items():
        if not getattr(method, ability):
            with pytest.raises(SceneError, match=f"method '{method.name}' takes no {words}"):
                vrte.brdf(scene, MU, MU, method=method.name)


def test_names() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 1.0)])
    with pytest.raises(SceneError, match=r"method must be 'discrete-ordinates', .*, not 'magic'"):
        vrte.brdf(scene, MU, MU, method="magic")
    with pytest.raises(SceneError, match="settings must be a dictionary"):
        vrte.brdf(scene, MU, MU, method=OTHERS[0], settings=[1])
    with pytest.raises(SceneError, match="method 'discrete-ordinates' has no settings"):
        vrte.brdf(scene, MU, MU, settings={"orders": 3})


NOT_THIN = {"two-stream", "diffusion", "small-angle"}  # what they do not claim


def test_thin_layers_scatter_once(method: Method) -> None:
    """Linear in the thickness, and the phase function's shape."""
    if method.name in NOT_THIN:
        pytest.skip("not claimed")
    phase = vrte.rayleigh() if method.polarization else vrte.henyey_greenstein(0.5, 12)
    scene = vrte.Scene([vrte.Layer(phase, 0.9, 1e-6)])
    found = vrte.brdf(scene, MU, MU, PHI, nodes=8, method=method.name)
    once = vrte.brdf(scene, MU, MU, PHI, nodes=8, method="single-scattering")
    np.testing.assert_allclose(found.mueller, once.mueller, atol=1e-4 * np.abs(once.mueller).max())


def test_energy(method: Method) -> None:
    """What claims to conserve energy does, in a pile of layers over a white base and without one."""
    if not method.conserves.startswith("energy"):
        pytest.skip("not claimed")
    phase = vrte.henyey_greenstein(0.7, 30)
    layers = [vrte.Layer(phase, 1.0, 0.3), vrte.Layer(vrte.isotropic(), 1.0, 4.0)] if method.layers else []
    layers = layers or [vrte.Layer(phase, 1.0, 4.0)]
    bases = [None, vrte.Lambertian(1.0)] if method.base else [None]
    for base in bases:
        scene = vrte.Scene(layers, base)
        tau = [0.0, scene.thickness] if method.transmission else [0.0]
        field = vrte.radiance(scene, 0.6, mu=[], tau=tau, nodes=16, method=method.name)
        if base is not None:
            np.testing.assert_allclose(field.flux_up[0], 0.6, rtol=1e-12)
        if method.transmission:
            net = field.flux_down + field.direct - field.flux_up
            np.testing.assert_allclose(net, net[0] if base is None else 0.0, rtol=1e-12, atol=1e-12)


def test_light_from_below(method: Method) -> None:
    """A layer alone has no top: the same from both sides, whatever the method."""
    phase = vrte.rayleigh() if method.polarization else vrte.henyey_greenstein(0.5, 12)
    scene, how = vrte.Scene([vrte.Layer(phase, 0.9, 0.7)]), {"nodes": 8, "method": method.name}
    transmission = method.transmission
    above, below = (
        vrte.brdf(scene, MU, MU, PHI, transmission=transmission, illuminate=side, **how) for side in ("top", "bottom")
    )
    flip = np.outer([1, 1, -1, -1], [1, 1, -1, -1])
    np.testing.assert_array_equal(below.mueller, above.mueller * flip)
    if transmission:
        np.testing.assert_array_equal(below.transmission, above.transmission * flip)
