"""The examples in the docstrings of bench hold."""

import doctest
import importlib
import pkgutil

import pytest

import bench

MODULES = [
    found.name
    for found in pkgutil.walk_packages(bench.__path__, "bench.")
    if not found.name.rpartition(".")[-1].startswith(("test_", "conftest", "__main__"))
]


@pytest.mark.parametrize("name", MODULES)
def test_examples_hold(name: str) -> None:
    assert doctest.testmod(importlib.import_module(name)).failed == 0
