"""What a solve asks of a device, and how long a GPU that is not at hand would take by the model."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.errors import DeviceError
from vrte.cl import device
from vrte.cl.matrices import choose_tile, make_stack, multiply_stacks
from vrte.cl.session import Session, read_sources
from vrte.studies import devices, estimate
from vrte.studies.device_counts import FORMULAS, Event, Recorder, Work, name_arguments, record_events
from vrte.studies.device_model import MACHINES, add_work, predict_launch, predict_run

from .conftest import call
from .helpers import close_to

H100, CONSUMER = MACHINES["H100"], MACHINES["RTX 4090"]
ALONE = {"mu_i": [0.3, 0.8], "mu_o": [0.2, 0.9], "phi": [0.0, 60.0], "nodes": 6, "backend": "opencl"}


@pytest.fixture
def recorder(opencl: Session) -> Iterator[Recorder]:
    """A recorder on the device that is taken, which it is for all solves."""
    found = device.find_chosen_device()
    made = estimate.open_recorder(found)
    with device.take_device(device.devices().index(found), made):
        yield made


def scene(thickness: float, base: Any = None) -> vrte.Scene:
    """Gold, small enough for few nodes."""
    gold = vrte.spheres("gold", radius_um=0.05, wavelength_um=0.6)
    layers = [vrte.Layer.of(gold, thickness=thickness), vrte.Layer(vrte.rayleigh(), 1.0, 0.5)]
    return vrte.Scene(layers[:1] if np.isinf(thickness) else layers, base)


class TestCounts:
    @pytest.mark.parametrize(("rows", "inner", "columns"), [(160, 80, 72), (64, 16, 64), (8, 3, 5)])
    def test_a_product(self, recorder: Recorder, rows: int, inner: int, columns: int) -> None:
        a, b, c = (make_stack(recorder, 3, *shape) for shape in ((rows, inner), (inner, columns), (rows, columns)))
        items = recorder.upload(np.arange(2, dtype=np.int32))
        with record_events(recorder, weighing=True) as events:
            multiply_stacks(recorder, items, a, b, c)
        (event,) = (event for event in events if event.what == "launch")
        tile = choose_tile(rows, columns)
        assert event.groups == -(-rows // tile) * -(-columns // tile) * 2
        assert event.lanes == (256 if tile == 64 else 64)
        least = 2.0 * rows * inner * columns * 2
        assert least <= event.work.flops <= least * 64 * 64 * 16 / (8 * 3 * 5)
        assert event.work.bytes == 8 * 2 * (rows * inner + inner * columns + rows * columns)

    @pytest.mark.slow
    def test_every_kernel_of_a_solve_has_its_row(self, recorder: Recorder) -> None:
        calls = [
            lambda turn: vrte.brdf(scene(np.inf), **ALONE, algorithm="invariance"),
            lambda turn: vrte.brdf(scene(2.0, vrte.Lambertian(0.4)), **ALONE, algorithm="doubling", transmission=True),
        ]
        for solve in calls:
            events = estimate.count_events(recorder, solve)
            launched = [event for event in events if event.what == "launch"]
            names = {event.name for event in launched}
            assert names <= set(FORMULAS)
            assert names == {event.name for event in launched if event.work.bytes > 0.0}
            assert sum(event.host for event in events) > 0.0
            read = sum(event.bytes for event in events if event.what == "read")
            assert read >= 8 * 2 * 2 * 2 * 16  # the result at least

    def test_rows_are_of_kernels_that_there_are(self) -> None:
        names = name_arguments(read_sources())
        assert not set(FORMULAS) - set(names)
        assert names["product_gpu"][-5:] == ["C", "C_first", "C_ld", "C_stride", "items"]

    def test_what_comes_down_is_what_came_down_when_it_was_weighed(self, recorder: Recorder) -> None:
        values = recorder.upload(np.arange(5000.0))
        with record_events(recorder, weighing=True):
            recorder.download(values)
        with record_events(recorder) as events:
            found = recorder.download(recorder.zeros((5000,)))
        np.testing.assert_array_equal(found, np.arange(5000.0))
        assert [event.what for event in events] == ["fill", "read", "host"]
        assert events[1].bytes == 40000.0

    @pytest.mark.slow
    def test_twice_the_scenes_are_twice_the_work(self, recorder: Recorder) -> None:
        def count(scenes: list[vrte.Scene]) -> Work:
            return add_work(estimate.count_events(recorder, lambda turn: vrte.brdfs(scenes, **ALONE)))

        one, two = count([scene(np.inf)]), count([scene(np.inf), scene(np.inf)])
        assert two.flops == close_to(2.0 * one.flops, rtol=0.1, atol=0.0)


class TestModel:
    def test_a_launch_with_much_to_multiply(self) -> None:
        event = Event("launch", 0.0, "product_gpu", groups=1e5, lanes=256, work=Work(1e12, 1e6))
        seconds, limit = predict_launch(H100, event)
        assert seconds == close_to(1e12 / H100.peak, rtol=0.01, atol=0.0)
        assert limit == "multiplying"
        assert predict_launch(CONSUMER, event)[0] > 20.0 * seconds

    def test_a_launch_with_much_memory(self) -> None:
        event = Event("launch", 0.0, "combine", groups=1e6, lanes=64, work=Work(1e6, 3.35e9))
        assert predict_launch(H100, event)[0] == close_to(1e-3, rtol=0.01, atol=0.0)

    def test_work_items_alone_wait_for_memory(self) -> None:
        event = Event("launch", 0.0, "combine", groups=64, lanes=1, work=Work(1e3, 1e6))
        assert predict_launch(H100, event)[1] == "waiting for memory"
        assert predict_launch(H100, replace(event, lanes=64))[0] < 0.1 * predict_launch(H100, event)[0]

    def test_host_and_device_beside_each_other(self) -> None:
        work = Event("launch", 1e-3, "combine", groups=1e6, lanes=64, work=Work(1e6, 3.35e9))
        machine = replace(H100, call=0.0)
        beside = predict_run(machine, [work] * 10)
        assert beside.seconds == close_to(11e-3, rtol=0.02, atol=0.0)  # the device begins when the host has asked
        waiting = predict_run(machine, [work, Event("read", 0.0, bytes=8.0)] * 10)
        assert waiting.seconds == close_to(20e-3, rtol=0.02, atol=0.0)
        assert beside.device == close_to(waiting.device, rtol=0.01, atol=0.0)
        assert predict_run(H100, [work] * 10).host == close_to(10e-3 + 10 * H100.call, rtol=1e-6, atol=0.0)
        assert predict_run(H100, [work], scale=4.0).device == close_to(4e-3, rtol=0.02, atol=0.0)

    def test_figures_of_data_sheets(self) -> None:
        rates = {name: machine.peak / 1e12 for name, machine in MACHINES.items()}
        assert rates == close_to({"H100": 33.5, "A100": 9.7, "RTX 4090": 1.29, "MI300X": 81.7}, rtol=0.01, atol=0.0)


class TestCommand:
    @pytest.mark.slow
    def test_the_table(
        self, opencl: Session, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setattr(estimate, "make_gold", lambda thickness, wavelength_um=0.0, turn=0: scene(thickness))
        monkeypatch.setattr(estimate.count_tasks, "__defaults__", (estimate.count_tasks.__defaults__[0], 2, 6))
        assert call("devices", "--estimate", "h100") == 0
        lines = capsys.readouterr().out.splitlines()
        assert [line.split("  ")[1] for line in lines[-3:]] == ["thick gold", "tau 5, doubling", "batch of 64"]
        assert sum("by the model" in line for line in lines) == 1

    def test_the_device_itself_is_measured(
        self, opencl: Session, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setattr(estimate, "make_gold", lambda thickness, wavelength_um=0.0, turn=0: scene(thickness))
        monkeypatch.setattr(estimate.time_tasks, "__defaults__", (estimate.time_tasks.__defaults__[0], 2, 6))
        monkeypatch.setattr(devices, "SECONDS", 1e-4)
        assert call("devices", "--estimate", "this") == 0
        assert "a blocking read" in capsys.readouterr().out

    def test_nobody_knows_it(self) -> None:
        with pytest.raises(DeviceError, match="no figures of 'Voodoo': choose one of H100, A100"):
            estimate.find_machines("Voodoo")
        assert len(estimate.find_machines("all")) == 4
