"""How a scene changes with a number, as data."""

import numpy as np
import pytest

import vrte


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"thickness": [1.0], "albedo": [0.0, 0.0]}, "one a layer"),
        ({"thickness": [np.nan], "albedo": [0.0]}, "finite"),
        ({"thickness": [0.0], "albedo": [0.0], "coefficients": [np.eye(6)]}, "cannot change"),
        ({"thickness": [0.0], "albedo": [0.0], "coefficients": [np.zeros((2, 5))]}, "must be \\(terms, 6\\)"),
        ({"thickness": [0.0], "albedo": [0.0], "is_outside": True}, "scene_at"),
    ],
)
def test_what_is_no_variation_is_refused_with_its_name(given, said):
    with pytest.raises(vrte.SceneError, match=said) as caught:
        vrte.Variation("p", 1.0, **given)
    assert caught.value.place == ("derivatives", "p")


def test_one_that_does_nothing_says_so():
    assert vrte.Variation("p", 1.0, [0.0], [0.0]).changes_nothing
    assert not vrte.Variation("p", 1.0, [0.0], [1.0]).changes_nothing
