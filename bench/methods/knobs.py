"""What each method is told, from coarse to fine: a curve of the report is one method over one knob."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bench.methods import peers
from bench.methods.advice import EXPONENTS, EXPONENTS_QUICK
from vrte.basics.errors import DeviceError
from vrte.methods import find_method
from vrte.request.how import AUTO, EXACT, METHODS

Options = Mapping[str, Any]  # keywords of vrte.radiance


@dataclass(frozen=True)
class Setting:
    """A point of a curve: what hovering tells, and the keywords."""

    label: str
    options: Options = field(default_factory=dict)


@dataclass(frozen=True)
class Curve:
    """A method, or a peer, over its knob; ``made_by``: a peer's version."""

    name: str
    method: str
    settings: tuple[Setting, ...]
    made_by: str = ""

    def key(self, setting: Setting) -> str:
        """Of one point, whatever the order of its keywords."""
        return json.dumps([self.name, self.method, setting.label, setting.options, self.made_by], sort_keys=True)


def vary_nodes(counts: tuple[int, ...], **options: Any) -> tuple[Setting, ...]:
    """The same with more and more nodes.

    >>> vary_nodes((4, 8))[1].label
    '8 nodes'
    """
    return tuple(Setting(f"{count} nodes", {"nodes": count, **options}) for count in counts)


def vary_accuracy(exponents: tuple[int, ...], **options: Any) -> tuple[Setting, ...]:
    """The same with finer and finer requests, nodes left to the plan."""
    return tuple(Setting(f"accuracy 1e-{k}", {"accuracy": 10.0**-k, **options}) for k in exponents)


def make_settings(*each: tuple[int | None, dict[str, Any]]) -> tuple[Setting, ...]:
    """Nodes (None: the method's own) and settings of each point.

    >>> make_settings((8, {"orders": 3}))[0].label
    '8 nodes, orders 3'
    """
    return tuple(
        Setting(
            ", ".join([*([f"{nodes} nodes"] if nodes else []), *(f"{name} {value}" for name, value in values.items())])
            or "no knob",
            ({"nodes": nodes} if nodes else {}) | ({"settings": values} if values else {}),
        )
        for nodes, values in each
    )


NODES, NODES_QUICK = (2, 4, 8, 16, 32, 64), (2, 8)
ACCURACIES, ACCURACIES_QUICK = (2, 3, 4, 6, 8, 10), (3, 6)
FINE = 1e-12  # accuracy where the nodes are the knob
# (name of the curve, settings) of each method other than the exact one; one that is not here goes over its nodes
KNOBS: dict[str, tuple[tuple[str, tuple[Setting, ...]], ...]] = {
    "adding-doubling": (
        ("adding-doubling", vary_nodes((2, 4, 8, 16, 32))),
        ("adding-doubling, start", make_settings(*((16, {"start": start, "thin": 0.25}) for start in (0, 1, 3)))),
    ),
    "diffusion": (
        ("diffusion", make_settings(*((None, {"boundary": boundary}) for boundary in ("marshak", "mark", "milne")))),
    ),
    "invariant-imbedding": (
        ("invariant-imbedding", vary_nodes((2, 4, 8, 16))),
        ("invariant-imbedding, rtol", make_settings(*((8, {"rtol": 10.0**-k}) for k in (2, 5, 8)))),
    ),
    "matrix-operator": (("matrix-operator", vary_nodes((2, 4, 8, 16, 32))),),
    "single-scattering": (("single-scattering", make_settings((None, {}))),),
    "small-angle": (("small-angle", make_settings((None, {}))),),
    "successive-orders": (
        ("successive-orders", vary_nodes((2, 4, 8, 16, 32))),
        ("successive-orders, orders", make_settings(*((16, {"orders": orders}) for orders in (1, 2, 4, 8, 16, 64)))),
    ),
    "synthetic-iteration": (
        *(
            (
                f"synthetic-iteration, {regular}",
                make_settings(*((None, {"regular": regular, "iterations": count}) for count in (1, 2, 3))),
            )
            for regular in ("two-stream", "diffusion")
        ),
        (f"synthetic-iteration, {EXACT}", make_settings(*((nodes, {"regular": EXACT}) for nodes in (2, 4, 8)))),
    ),
    "two-stream": (("two-stream", make_settings((None, {}))),),
}


def list_curves(quick: bool = False) -> tuple[Curve, ...]:
    """All of them: of the exact method, over nodes by each algorithm, over the accuracy asked for, on an OpenCL device;
    of every other method registered; of whatever auto takes, over the accuracy asked for (its rows say which method
    that was); of every peer that is installed, over its streams, two for a node of a hemisphere.

    Where quick, a coarse and a middle point of each.

    >>> [curve.name for curve in list_curves(quick=True)][0]
    'discrete-ordinates, modes'
    """
    nodes, accuracies = (NODES_QUICK, ACCURACIES_QUICK) if quick else (NODES, ACCURACIES)
    few = pick_coarse_and_middle if quick else tuple[Setting, ...]
    found = [
        Curve(f"{EXACT}, {name}", EXACT, vary_nodes(nodes, algorithm=name, accuracy=FINE))
        for name in ("modes", "doubling")
    ]
    found.append(Curve(f"{EXACT}, accuracy", EXACT, vary_accuracy(accuracies)))
    if not quick:
        found.append(Curve(f"{EXACT}, sequential", EXACT, vary_accuracy((3, 6, 10), backend="sequential")))
        if has_device():
            found.append(Curve(f"{EXACT}, opencl", EXACT, vary_accuracy(accuracies, backend="opencl")))
    for method in METHODS:
        if method != EXACT:
            each = KNOBS.get(method, ((method, vary_nodes(NODES)),))
            found += [Curve(name, method, few(settings)) for name, settings in each]
    found.append(Curve(AUTO, AUTO, vary_accuracy(EXPONENTS_QUICK if quick else EXPONENTS)))
    for peer in peers.list_installed():
        settings = tuple(Setting(f"{streams} streams", {"streams": streams}) for streams in peer.streams)
        found.append(Curve(f"{peer.name}{peer.lacks}", peer.name, few(settings), peer.made_by))
    return tuple(found)


def pick_coarse_and_middle(settings: tuple[Setting, ...]) -> tuple[Setting, ...]:
    """The first setting and the one halfway."""
    half = len(settings) // 2
    return settings[: half + 1 : max(1, half)]


def has_device() -> bool:
    """Whether a solve would find an OpenCL device."""
    try:
        from vrte.cl.device import find_chosen_device

        find_chosen_device()
    except (ImportError, DeviceError):
        return False
    return True


def list_unknown_settings() -> list[str]:
    """Settings in KNOBS that their method does not have; none where the table is right."""
    return [
        f"{method}: {name}"
        for method, each in KNOBS.items()
        for _, settings in each
        for setting in settings
        for name in setting.options.get("settings", {})
        if method in METHODS and name not in find_method(method).settings
    ]
