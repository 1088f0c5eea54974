"""What every test can ask for."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

REFERENCE = Path(os.environ.get("VRTE_REFERENCE", Path(__file__).parents[2] / "shared" / "reference"))


@pytest.fixture(scope="session")
def reference() -> Callable[[str], Path]:
    """The path of a published table, or a skip that says where it was looked for."""

    def find(name: str) -> Path:
        path = REFERENCE / name
        if not path.exists():
            pytest.skip(f"published table {name} not found in VRTE_REFERENCE ({REFERENCE.name})")
        return path

    return find


@pytest.fixture(scope="session")
def opencl() -> Any:
    """The session on the OpenCL device that `vrte devices` takes."""
    from vrte.cl.device import session

    return session()
