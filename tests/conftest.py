"""What every test can ask for."""

import os
import shutil
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.llvm import prepare_llvm

DEVICE = pytest.StashKey[str]()
REFERENCE = Path(os.environ.get("VRTE_REFERENCE", Path(__file__).parents[2] / "shared" / "reference"))

prepare_llvm()  # before whichever test imports Mitsuba first


@pytest.fixture(scope="session")
def reference() -> Callable[[str], Path]:
    """The path of a published table, or a skip that says where it was looked for."""

    def find(name: str) -> Path:
        path = REFERENCE / name
        if not path.exists():
            pytest.skip(f"published table {name} not found in VRTE_REFERENCE ({REFERENCE.name})")
        return path

    return find


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """The browser that VRTE_CHROMIUM names, or the system's; a skip where there is none."""
    names = "chromium", "chromium-browser", "google-chrome"
    program = os.environ.get("VRTE_CHROMIUM") or next(filter(None, map(shutil.which, names)), None)
    if program is None:
        pytest.skip(f"no browser here: none of {', '.join(names)} is installed, VRTE_CHROMIUM names none")
    from playwright.sync_api import sync_playwright

    graphics = "--use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"
    flags = f"--no-sandbox --disable-background-networking {graphics}".split()
    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=program, args=flags)
        yield found
        found.close()


@pytest.fixture
def opencl(request: pytest.FixtureRequest) -> Any:
    """The session on the OpenCL device that `vrte devices` takes; a skip where there is none."""
    skip_without_device()
    opened = working_session()
    request.config.stash[DEVICE] = f"{opened.device.name} ({opened.device.platform.name.strip()})"
    return opened


@cache
def open_width(handle: Any, lanes: int) -> Any:
    """A session on a device with so many work-items for a piece of work."""
    from vrte.cl.session import open_session

    return open_session(handle, lanes)


def skip_without_device() -> None:
    """Ends the test where OpenCL has no device at all; one that fails is a failure."""
    from vrte.cl import device

    try:
        device.devices()
    except (vrte.DeviceError, vrte.MissingExtraError) as none:
        pytest.skip(str(none))


def working_session() -> Any:
    """The session of this process, opened anew where its device was lost: numbers go there and come back."""
    import pyopencl

    from vrte.cl import device

    opened = device.session()
    try:
        opened.download(opened.upload(np.arange(2.0)))
    except pyopencl.Error:
        device.forget()
        opened = device.session()
    return opened


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """As in a process that has not used OpenCL yet; what the test opens is forgotten after it."""
    from vrte.cl import device

    state = {"process": None, "devices": None, "sessions": {}, "complaints": {}}
    monkeypatch.setattr(device, "_state", state)
    monkeypatch.delenv(device.VARIABLE, raising=False)
    return state


@pytest.fixture(params=[1, pytest.param(64, marks=pytest.mark.slow)])  # compiles for long
def either_width(request: pytest.FixtureRequest, opencl: Any) -> Any:
    """Sessions on that device with one work-item for a piece of work, as on a processor, and with 64, as on a GPU."""
    return open_width(opencl.device, request.param)


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Names the device that the tests had."""
    if DEVICE in config.stash:
        terminalreporter.write_line(f"OpenCL device: {config.stash[DEVICE]}")
