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


@pytest.fixture(scope="session", params=["cpu", "gpu"])
def either_form(request: pytest.FixtureRequest, opencl: Any) -> Any:
    """Sessions on that device with the kernels as a CPU wants them, and as a GPU does."""
    from vrte.cl.session import open_session

    return opencl if request.param == opencl.form else open_session(opencl.device, request.param)
