"""Kernels of a device: products and inverses beside NumPy's, and what tests/test_engines.py does not see: that items do
not depend on each other, many scenes at once, ends, launches and waits."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pyopencl
import pytest

import vrte
from bench.cases import find_scene
from vrte import _core
from vrte.basics.running import Run, ThreadTeam
from vrte.cl import assembly, invariance
from vrte.cl.building import KERNEL, arrange, read_declared, write_parameters
from vrte.cl.doubling import double_slabs as double_on_device
from vrte.cl.matrices import Stack, download_stack, invert, make_stack, multiply_stacks, upload_stack
from vrte.cl.session import OPTIONS, Session, Traffic, read_sources
from vrte.discrete_ordinates.execution.engines import opencl as engine
from vrte.discrete_ordinates.orders.doubling import Slabs, double_slabs
from vrte.discrete_ordinates.orders.phase_assembly import assemble
from vrte.discrete_ordinates.orders.slabs import SlabStack, cut_layers

from .helpers import assert_close
from .opencl_scenes import SCENES, kernels_with, problem_of

ORDERS = np.array([0, 1, 3], np.int32)
SIZES = ((1, 1, 1), (3, 5, 2), (8, 8, 8), (13, 40, 7), (65, 17, 66), (100, 30, 129), (96, 33, 31), (120, 7, 80))


def a_crew(stopped: bool = False) -> ThreadTeam:
    """Who has not worked yet."""
    return ThreadTeam(1, np.zeros(1), np.full(1, stopped, np.int32))


def integers(*lists: Sequence[int]) -> list[np.ndarray]:
    return [np.array(values, np.int32) for values in lists]


def test_products(either_width: Session) -> None:
    """Of rows, inner, columns; with nothing of what was there where beta is 0, and padding that stays 0."""
    for rows, inner, columns in SIZES:
        rng = np.random.default_rng(rows)
        for by_transpose, beta in product((False, True), (-0.7, 0.0)):
            a = rng.standard_normal((4, inner, rows))
            b = rng.standard_normal((4, inner, columns) if by_transpose else (4, columns, inner))
            c = rng.standard_normal((4, columns, rows)) if beta else np.full((4, columns, rows), np.nan)
            stacks = [upload_stack(either_width, values) for values in (a, b, c)]
            multiply_stacks(either_width, *stacks, 1.5, beta, by_transpose)
            expected = c.copy()
            for item in range(4):
                right = b[item] if by_transpose else b[item].T
                expected[item] = (1.5 * a[item].T @ right + (beta * c[item].T if beta else 0.0)).T
            assert_close(download_stack(either_width, stacks[2]), expected, rtol=0.0, atol=1e-14 * inner)
            assert not either_width.download(stacks[2].data).reshape(4, columns, -1)[:, :, rows:].any()


def test_a_part_leaves_the_others_alone(either_width: Session) -> None:
    a, c = np.random.default_rng(2).random((2, 2, 24, 24))
    big, small = upload_stack(either_width, c), upload_stack(either_width, a)
    multiply_stacks(either_width, small.part(8, 0, 8, 24), small, big.part(16, 5, 8, 7))
    for item in range(2):
        c[item].T[16:24, 5:12] = a[item].T[8:16] @ a[item].T[:, :7]
    assert_close(download_stack(either_width, big), c, rtol=1e-13, atol=0.0)


MATRICES = {n: np.random.default_rng(n).standard_normal((3, n, n)) for n in (1, 7, 16, 17, 40, 83, 160)}
MATRICES[50] = np.stack([np.roll(np.diag(np.arange(1.0, 51.0)), 7, axis=0)] * 3)  # rows have to be exchanged


def test_inverses(either_width: Session) -> None:
    for rows, stored in MATRICES.items():
        found, info = inverted(either_width, stored)
        assert not info.any()
        for item in range(3):
            atol = 1e-14 * np.linalg.cond(stored[item])
            assert_close(found[item] @ stored[item], np.eye(rows), rtol=0.0, atol=atol)


def inverted(session: Session, stored: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(item, column, row) after `invert`, and info."""
    stack = upload_stack(session, stored)
    info = invert(session, stack)
    return download_stack(session, stack), session.download(info)


def test_what_cannot_be_inverted_or_is_nothing(either_width: Session) -> None:
    session = either_width
    stored = np.stack([np.eye(20), np.eye(20), np.zeros((20, 20))])
    stored[1][18, 18] = 0.0
    found, info = inverted(session, stored)
    np.testing.assert_array_equal(info, [0, 1, 1])
    np.testing.assert_array_equal(found[0], np.eye(20))
    none = make_stack(session, 0, 5, 5)
    multiply_stacks(session, none, none, none)
    assert not inverted(session, np.zeros((0, 5, 5)))[0].size
    with pytest.raises(AssertionError):  # parts begin at strips
        Stack(None, 20, 20, 24, 480).part(5, 0, 8, 8)


def ask_of_two_materials() -> list[Any]:
    """Coefficients, terms and albedo of two materials with b2, the second one of fewer terms; directions of five nodes
    and two others, weights."""
    nodes, weights = np.polynomial.legendre.leggauss(5)
    degree, draw = np.arange(7)[:, None], np.random.default_rng(7)
    table = draw.normal(size=(7, 6)) * (2 * degree + 1) * 0.8**degree / 3.0  # of a strength that a scene can have
    table[0, 0] = 1.0
    directions = np.concatenate([(nodes + 1.0) / 2.0, [0.3, 0.77]])
    return [np.stack([table, 0.5 * table]), np.array([7, 5], np.int32), np.array([0.9, 0.6]), directions, weights / 2.0]


@pytest.mark.parametrize("stage", ["assemble", "reflect_semi_infinite"])
def test_an_item_does_not_depend_on_the_others(either_width: Session, stage: str) -> None:
    """Nor on a material or a tolerance that is not its own, in any order."""
    coefficients, terms, albedo, directions, weights = ask_of_two_materials()
    order, material, tolerance = *integers([4, 0, 1, 2], [0, 1, 0, 1]), np.array([1e-3, 1e-12, 1e-6, 1e-9])
    out, into, going = integers([0], [1], [0])

    def find(items: Sequence[int], stop: np.ndarray = going) -> list[np.ndarray]:
        pairs = order[list(items)], material[list(items)]
        what = assembly.upload_scattering(either_width, *pairs, coefficients, terms, albedo, range(4))
        if stage == "assemble":
            return [download_stack(either_width, assembly.assemble(either_width, what, directions, weights, 1).E)]
        ends = out, into, np.eye(4), tolerance[list(items)], stop
        return list(invariance.reflect_semi_infinite(either_width, what, directions, weights, *ends))

    whole = find([0, 1, 2, 3])
    for items in ([3], [2, 0], [1, 3, 2]):
        for part, complete in zip(find(items), whole, strict=True):
            assert (part == complete[items]).all()
    if stage == "reflect_semi_infinite":
        assert (whole[2] <= tolerance).all()
        assert find([0], np.ones(1, np.int32))[3][0] < find([0])[3][0]


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("albedo", [0.9, 0.0])
def test_invariance_takes_the_steps_that_the_core_takes(either_width: Session, tolerance: float, albedo: float) -> None:
    """The last order has nothing to scatter, and neither has a clear layer: they send nothing back."""
    coefficients, _, _, directions, weights = ask_of_two_materials()
    orders, members, out, into, terms = integers([1, 2, 3, 4, 5, 9], range(4), [0], [1], [7])
    given = {"orders": orders, "members": members, "coefficients": coefficients[:1], "terms": terms}
    given |= {"albedo": np.array([albedo]), "directions": directions, "weights": weights}
    given |= {"out_places": out, "in_places": into, "columns": np.eye(4)}
    answers = []
    for kernel in (
        lambda *a, **b: invariance.reflect_semi_infinite_arrays(either_width, *a, **b),
        _core.reflect_semi_infinite,
    ):
        shapes = {"up": (6, 1, 4, 4), "on_nodes": (6, 4, 20), "residual": (6,)}
        answer = {name: np.full(shape, np.nan) for name, shape in shapes.items()} | {"steps": np.full(6, -1, np.int32)}
        kernel(a_crew(), **given, tolerance=tolerance, halves=True, coarse=True, **answer)
        answers.append(answer)
    found, expected = answers
    np.testing.assert_array_equal(found["steps"], expected["steps"])
    assert_close(found["residual"], expected["residual"], rtol=1e-3, atol=1e-14)
    for name in ("up", "on_nodes"):
        assert_close(found[name], expected[name], rtol=0.0, atol=1e-11 * np.abs(expected[name]).max())
        assert not found[name][-1].any()
        assert albedo or not found[name].any()


def test_kernels_take_what_is_declared(opencl: Session) -> None:
    """Names and types of each kernel's parameters, as the driver has compiled them, in the order of a launch."""
    info, qualifiers = pyopencl.kernel_arg_info, pyopencl.kernel_arg_type_qualifier
    text = write_parameters() + read_sources()
    program = pyopencl.Program(opencl.context, text).build([*OPTIONS, "-D", "LANES=1", "-cl-kernel-arg-info"])
    assert {"probe", *KERNEL.findall(read_sources())} == read_declared().keys()
    for name, taken in read_declared().items():
        if name == "probe":  # of a program of its own
            continue
        kernel = pyopencl.Kernel(program, name)
        found, wanted = [], []
        for k in range(kernel.num_args):
            found.append((kernel.get_arg_info(k, info.NAME), kernel.get_arg_info(k, info.TYPE_NAME)))
            constant = kernel.get_arg_info(k, info.TYPE_QUALIFIER) & qualifiers.CONST
            assert bool(constant) == any(
                each.name == found[k][0] and not each.writes
                for each in taken
                if each.form in ("double", "int") and each.dims
            ), (name, found[k])
        for each in taken:
            kind = {"int": "int", "vrte_slab": "vrte_slab", "whole": "int", "flag": "int"}.get(each.form, "double")
            wanted.append((each.name, kind + "*" * bool(each.dims)))
            if each.form in ("stack", "overlapping"):
                wanted += [
                    (f"{each.name}_{part}", of) for part, of in (("first", "long"), ("ld", "int"), ("stride", "long"))
                ]
        assert found == wanted, name


@pytest.mark.parametrize(
    ("given", "kind", "message"),
    [
        ({"M": (2, 3, 3), "info": (3,)}, ValueError, r"invert: info must have the shape \(n_item 2\), not \(3,\)"),
        ({"M": (2, 3), "info": (2,)}, ValueError, r"M must have the shape \(n_item 2, n 3, n 3\), not \(2, 3\)"),
        ({"M": (2, 3, 3), "info": (2,), "n": 4}, ValueError, "n must be 3, not 4"),
        ({"M": (2, 3, 3)}, TypeError, "invert needs info"),
        ({"M": (2, 3, 3), "info": (2,), "N": (1,)}, TypeError, "invert does not take N"),
    ],
)
def test_arguments_of_kernels_are_checked(given: dict[str, Any], kind: type[Exception], message: str) -> None:
    found: dict[str, Any] = {
        key: np.zeros(shape) if isinstance(shape, tuple) else shape for key, shape in given.items()
    }
    with pytest.raises(kind, match=message):
        arrange("invert", {"rest": np.zeros((2, 48)), "pivots": np.zeros((2, 3), np.int32)}, found)


def doubled(stack: SlabStack, orders: np.ndarray, kernels: Any) -> Slabs:
    """R and T by some kernels."""
    run = Run(1)
    matrices = assemble(stack.problem, orders, run)
    return double_slabs(stack.problem, stack.material, stack.thickness, orders, matrices, Run(1, kernels=kernels))


def test_slabs_do_not_depend_on_each_other_and_end_when_told(opencl: Session) -> None:
    stack = cut_layers(problem_of(SCENES["repeated"], 5))
    kernels = kernels_with(opencl, double_slabs=double_on_device)
    together, alone = doubled(stack, ORDERS, kernels), doubled(stack, ORDERS[1:2], kernels)
    np.testing.assert_array_equal(together.R[1], alone.R[0])
    np.testing.assert_array_equal(together.T[1], alone.T[0])
    run, found = Run(1, kernels=kernels), assemble(stack.problem, ORDERS, Run(1))
    run.stop[0] = 1
    with pytest.raises(KeyboardInterrupt):
        double_slabs(stack.problem, stack.material, stack.thickness, ORDERS, found, run)


def test_what_goes_to_and_from_a_device_is_counted(opencl: Any) -> None:
    before = Traffic(**vars(opencl.traffic))
    small, large = opencl.upload(np.ones(3)), opencl.upload(np.ones(3000))
    opencl.zeros((5,))
    opencl.launch("invert", (0,))  # of nothing: not launched
    opencl.download(small)
    opencl.download(large)
    opencl.finish()
    size = np.dtype(opencl.real).itemsize
    found = opencl.traffic.since(before)
    assert found == Traffic(
        launches=0, fills=1, reads=2, waits=2, bytes_up=3003 * size, bytes_down=3003 * size
    )  # a large array is waited for on its way up


GOLD, MU = find_scene("gold"), np.linspace(0.05, 1.0, 20)
THIN_GOLD = replace(GOLD, layers=[replace(GOLD.layers[0], thickness=5.0)])
RAYLEIGH = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 5.0)])


@pytest.mark.parametrize(
    ("scene", "algorithm", "mu", "nodes", "most"),  # most: launches and reads
    [
        (GOLD, "invariance", MU[[0, -1]], 8, (100, 25)),
        (RAYLEIGH, "doubling", MU[[0, -1]], 4, (80, 18)),
        pytest.param(GOLD, "invariance", MU, 40, (100, 25), marks=pytest.mark.slow),
        pytest.param(THIN_GOLD, "doubling", MU, 40, (90, 25), marks=pytest.mark.slow),
    ],
)
def test_few_launches_and_reads(
    opencl: Any, scene: vrte.Scene, algorithm: str, mu: np.ndarray, nodes: int, most: tuple[int, int]
) -> None:
    """Doubling reads how many doublings are left, and what it ends with, of each block of orders; each sum is read."""
    how: dict[str, Any] = {"nodes": nodes, "algorithm": algorithm, "backend": "opencl"}
    found = Traffic(**vrte.brdf(scene, mu, mu, np.arange(0, 361, 10), **how).diagnostics["traffic"])
    assert 0 < found.launches <= most[0]
    assert 0 < found.reads <= most[1]
    assert found.bytes_down >= 8 * mu.size**2 * 37 * 16


@pytest.mark.parametrize(("algorithm", "thickness"), [("invariance", np.inf), ("doubling", 1.5)])
def test_sums_of_many_scenes_take_as_many_launches_as_those_of_one(
    either_width: Any, monkeypatch: pytest.MonkeyPatch, algorithm: str, thickness: float
) -> None:
    """Of the same Fourier orders; each result is that of its scene alone to the last bit, in small batches as well."""
    monkeypatch.setattr(engine, "open_session", lambda precision="double": either_width.in_precision(precision))
    launched: list[str] = []
    launch = Session.launch

    def noted(session: Session, name: str, *arguments: Any, **named: Any) -> None:
        launched.append(name)
        launch(session, name, *arguments, **named)

    monkeypatch.setattr(Session, "launch", noted)
    mu, phi = np.array([0.3, 0.9]), np.array([0.0, 50.0, 310.0])
    kinds = (0.9, 0.0), (0.5, 0.03), (0.7, 0.1)  # albedo and depolarization
    scenes = [vrte.Scene([vrte.Layer(vrte.rayleigh(kind), albedo, thickness)]) for albedo, kind in kinds]
    asked: dict[str, Any] = {"nodes": 4, "backend": "opencl", "algorithm": algorithm}
    asked["transmission"] = bool(np.isfinite(thickness))

    def solve(scenes: list[vrte.Scene]) -> tuple[list[np.ndarray], int]:
        launched.clear()
        found = vrte.brdfs(scenes, mu, mu, phi, **asked)
        light = [
            np.concatenate([each for each in (one.mueller, one.transmission) if each is not None]) for one in found
        ]
        return light, sum(name.startswith(("add_orders", "add_scattering")) for name in launched)

    together, few = solve(scenes)
    alone = [solve([scene]) for scene in scenes]
    assert few == max(launches for _, launches in alone)
    monkeypatch.setattr(engine, "TOGETHER", 1.0)
    in_batches, many = solve(scenes)
    assert many == sum(launches for _, launches in alone)
    for whole, batch, (one, _) in zip(together, in_batches, alone, strict=True):
        np.testing.assert_array_equal(whole, one[0])
        np.testing.assert_array_equal(batch, one[0])
