"""A plan in words and numbers: a short table, what is left out and why, what is shared, predicted work and memory."""

import re
import textwrap
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.memory import BYTES
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.routes import OTHER, is_quick
from vrte.discrete_ordinates.orders.slabs import cut, distinct_materials
from vrte.discrete_ordinates.planning.azimuths import fold
from vrte.discrete_ordinates.planning.blocks import Block
from vrte.discrete_ordinates.planning.choice import is_symmetric
from vrte.discrete_ordinates.planning.memory import doubles_needed
from vrte.discrete_ordinates.planning.needs import sets_of
from vrte.discrete_ordinates.planning.operations import operations_of_block, operations_of_sums
from vrte.request.request import EXACT

if TYPE_CHECKING:
    from vrte.discrete_ordinates.planning.plan import Plan

HEADER = ("orders", "Stokes", "nodes", "layers", "unknowns", "right-hand sides", "algorithm", "operations")
LEFT = ("orders", "Stokes", "algorithm")  # columns of text
SETTLES = 80.0  # optical thickness: half of it passes less than the rounding of 1
WIDTH = 120


def text_of(plan: "Plan") -> str:
    """The whole, lines of at most 120 characters."""
    if plan.parts:
        texts = (f"Light that comes in {kind}, by itself:\n{text_of(part)}" for kind, part in named_parts(plan))
        return "\n\n".join(texts)
    if is_another_method(plan):
        return "\n".join([*head(plan), "", wrapped(f"{plan.request.method}: {plan.request.method_rule}")])
    facts = plan.as_dict()
    rows = [row_of(block) for block in facts["blocks"]]
    lines = [*head(plan), "", *aligned([HEADER, *rows]), ""]
    lines += [wrapped(reason) for reason in reasons_of(facts["blocks"])]
    lines += [wrapped(text) for text in remarks(plan)]
    lines += section("Left out", facts["left_out"].values())
    lines += section("Shared", facts["shared"])
    lines += ["", f"Predicted: {facts['operations']:.1e} operations, {in_megabytes(facts['memory_bytes'])} of memory"]
    return "\n".join(lines)


def facts_of(plan: "Plan") -> dict[str, Any]:
    """The same as numbers and strings, for programs."""
    if plan.parts:
        parts = {kind: facts_of(part) for kind, part in named_parts(plan)}
        return {"kind": plan.request.kind, "accuracy": plan.request.accuracy, "threads": plan.threads, "parts": parts}
    if is_another_method(plan):
        asked = {"kind": plan.request.kind, "accuracy": plan.request.accuracy, "threads": plan.threads}
        return asked | {"method": plan.request.method, "method_rule": plan.request.method_rule}
    request, problem, azimuths = plan.request, plan.problem, fold(plan.request.phi, plan.problem.leave_out.azimuths)
    blocks = [facts_of_block(plan, block) for block in plan.blocks]
    result = plan.wanted.doubles(request.phi.size)
    doubles = doubles_needed(problem, plan.blocks, result, azimuths, plan.threads)
    sums = operations_of_sums(problem, plan.blocks, plan.wanted, azimuths)
    return {
        "kind": request.kind,
        "accuracy": request.accuracy,
        "nodes": int(problem.nodes.size),
        "nodes_rule": plan.choice.rule,
        "threads": plan.threads,
        "method": EXACT,
        "method_rule": request.method_rule,
        "truncation": plan.truncation.name,
        "orders": sorted({order for block in blocks for order in block["orders"]}),
        "orders_counted_again": plan.counts_again,
        "blocks": blocks,
        "left_out": left_out(plan),
        "shared": shared(plan),
        "notes": list(plan.notes),
        "operations": sums + sum(block["operations"] for block in blocks),
        "memory_bytes": BYTES * doubles,
    }


def is_another_method(plan: "Plan") -> bool:
    """Whether the rules of "auto" took a method that has no such plan."""
    return bool(plan.request.method_rule) and plan.request.method != EXACT


def named_parts(plan: "Plan") -> list[tuple[str, "Plan"]]:
    """The plans of light that comes in unpolarized, and polarized, where they differ."""
    return list(zip(("unpolarized", "polarized"), plan.parts, strict=True))


def facts_of_block(plan: "Plan", block: Block) -> dict[str, Any]:
    """A block's row."""
    return {
        "orders": block.orders.tolist(),
        "stokes": named(block.stokes),
        "nodes": int(block.problem.nodes.size),
        "layers": int(block.problem.albedo.size),
        "bottom": bool(np.isfinite(block.problem.thickness[-1])),
        "unknowns": block.problem.size,
        "right_hand_sides": block.problem.n_rhs,
        "algorithm": block.choice.name,
        "reason": block.choice.reason,
        "operations": operations_of_block(block, plan.needs.strength[block.orders], plan.accuracy),
    }


def head(plan: "Plan") -> list[str]:
    """What is asked for."""
    request, base = plan.request, plan.diagnostics()["base"]
    layers = counted(len(request.scene.layers), "layer")
    into, out, depths = request.mu0.size, plan.mu.size, counted(request.tau.size, "depth")
    if request.kind == "brdf":
        out //= request.tau.size
        asked = (
            f"{into} mu_i, {out} mu_o, {request.phi.size} phi, {'with' if request.tau.size > 1 else 'no'} transmission"
        )
    elif request.fluxes_only:
        asked = f"fluxes alone, {depths}"
    else:
        asked = f"{counted(into, 'beam')}, {depths}, {out} mu, {request.phi.size} phi"
    accuracy = f"accuracy {request.accuracy:g} of the largest I"
    backend = request.backend
    threads = counted(plan.threads, "thread") if backend.label == "openmp" else f"backend {backend.label}"
    return [
        f"Plan of {request.kind}: {layers}, base {base}; {accuracy}, {plan.problem.nodes.size} nodes, {threads}",
        asked,
    ]


def reasons_of(blocks: Sequence[dict[str, Any]]) -> list[str]:
    """Why each algorithm was taken; the first of reasons that differ in their numbers alone."""
    alike: dict[str, list[str]] = {}
    for block in blocks:
        reason = f"{block['algorithm']}: {block['reason']}"
        alike.setdefault(re.sub(r"[0-9]\S*", "", reason), []).append(reason)
    return [f"{found[0]}{' (the first of these blocks)' if len(set(found)) > 1 else ''}" for found in alike.values()]


def remarks(plan: "Plan") -> list[str]:
    """What may happen besides."""
    request = plan.request
    chosen = request.nodes is None or bool(request.method_rule)
    found = [request.method_rule] if request.method_rule else []
    found += [f"nodes: {plan.choice.rule}", *plan.notes] if chosen else [*plan.notes]
    if plan.truncation.name != "none":
        found.append(f"Truncation: {plan.truncation.name} ({plan.truncation.reason})")
    if plan.counts_again and plan.orders > 1:
        found.append(
            "The orders are counted again with the light that the first ones bring: fewer may be solved, never more."
        )
    if plan.request.verify:
        others = sorted({OTHER[block.choice.name] for block in plan.blocks})
        found.append(f"verify: every block once more by {' or '.join(others)}.")
    return found


def left_out(plan: "Plan") -> dict[str, str]:
    """What is not done, by the name of its switch, and why."""
    reasons = {
        "stokes": why_stokes(plan),
        "columns": why_columns(plan),
        "orders": why_orders(plan),
        "single": why_single(plan),
        "fluxes": why_fluxes(plan),
        "normal": why_normal(plan),
        "nodes": why_nodes(plan),
        "depth": why_depth(plan),
        "clear": why_clear(plan),
        "repeats": why_repeats(plan),
        "doublings": why_doublings(plan),
        "base": why_base(plan),
        "azimuths": why_azimuths(plan),
        "symmetric": why_symmetric(plan),
        "halves": why_halves(plan),
        "transmission": why_transmission(plan),
    }
    allowed = plan.problem.leave_out
    return {name: reason for name, reason in reasons.items() if reason and getattr(allowed, name, True)}


def why_stokes(plan: "Plan") -> str:
    """Sets of Stokes parameters solved apart, or not at all."""
    sets = {block.stokes for block in plan.blocks}
    if plan.fed_back or sets <= {ALL}:
        return ""
    a2, a3, a4, b1, b2 = present(plan.problem)
    if not (a2 or a3 or a4 or b1 or b2):
        return "Q, U and V: the phase functions are scalar and scatter I alone"
    reasons = []
    if any(block.orders[0] == 0 for block in plan.blocks) and plan.orders > 0:
        reasons.append("order 0 keeps I, Q and U, V apart")
    if not b2:
        reasons.append("b2 = 0 keeps V apart from I, Q, U")
    missing = set(ALL) - {place for members in sets_of(True, a2, a3, a4, b1, b2) for place in members}
    if missing:
        reasons.append(f"{named(missing)} does not scatter")
    return f"couplings of Stokes parameters: {'; '.join(reasons)}"


def present(problem: Problem) -> tuple[bool, ...]:
    """Which of a2, a3, a4, b1, b2 any layer has."""
    found: list[bool] = (problem.coefficients[problem.albedo > 0.0] != 0.0).any(axis=(0, 1)).tolist()
    return tuple(found[1:])


def why_columns(plan: "Plan") -> str:
    """Right-hand sides without light."""
    request = plan.request
    if request.kind == "radiance" and request.columns.shape[0] == 1:
        dark = "I, Q" if request.columns[0, 2:].any() else "U, V"
        part = 1 if dark == "I, Q" else 2
        return f"right-hand sides of light that comes in as {dark}: there is none (no k = {part} part)"
    count = request.columns.shape[0]
    if any(len(block.columns) < count for block in plan.blocks):
        return f"right-hand sides without light: of {count} incident Stokes columns each block takes its own alone"
    return ""


def why_orders(plan: "Plan") -> str:
    """Orders of multiple scattering."""
    last = int(plan.problem.terms.max()) - 1
    if plan.fed_back or plan.request.fluxes_only or plan.orders > last:
        return ""
    orders = spelled(range(plan.orders, last + 1), "order")
    return f"multiple scattering of {orders}: together they add less than 0.4 of the accuracy"


def why_single(plan: "Plan") -> str:
    """Single scattering by orders."""
    layers = [layer for layer in plan.request.scene.layers if layer.albedo > 0.0]
    if not layers or plan.request.fluxes_only:
        return ""
    terms = max(layer.phase_matrix.terms for layer in layers)
    return f"single scattering order by order: all {terms} in closed form, at the scattering angle of every pair"


def why_fluxes(plan: "Plan") -> str:
    """Orders that carry no flux."""
    return "all orders but 0: fluxes alone are asked for" if plan.request.fluxes_only and not plan.fed_back else ""


def why_normal(plan: "Plan") -> str:
    """Orders that are zero along the normal."""
    if plan.request.fluxes_only or plan.orders == 1:
        return ""
    for name, cosines in (("incidence", plan.problem.mu0), ("exit", plan.problem.mu_out)):
        if (cosines == 1.0).all():
            return f"all orders but 0 (I, V) and 2 (Q, U): there are no others at normal {name}"
    return ""


def why_nodes(plan: "Plan") -> str:
    """Nodes near the normal."""
    total = plan.problem.nodes.size
    fewest = min((block.problem.nodes.size for block in plan.blocks), default=total)
    if fewest == total:
        return ""
    orders = [order for block in plan.blocks if block.problem.nodes.size < total for order in block.orders.tolist()]
    return f"nodes near mu = 1 that an order does not see: {spelled(orders, 'order')}, down to {fewest} of {total}"


def why_depth(plan: "Plan") -> str:
    """Layers and the bottom of layers."""
    total, reasons = plan.problem.albedo.size, []
    ended = bool(np.isfinite(plan.problem.thickness[-1]))
    shallow = {block.problem.albedo.size: [] for block in plan.blocks}  # type: dict[int, list[int]]
    endless: list[int] = []
    for block in plan.blocks:
        shallow[block.problem.albedo.size] += block.orders.tolist()
        if np.isinf(block.problem.thickness[-1]) and (ended or block.problem.albedo.size < total):
            endless += block.orders.tolist()
    for layers, orders in shallow.items():
        if layers < total:
            reasons.append(f"below layer {layers} of {total} for {spelled(orders, 'order')}")
    if endless:
        reasons.append(f"the bottom of the last layer reached, optically infinite for {spelled(endless, 'order')}")
    return f"what no light comes back from: {'; '.join(reasons)}" if reasons else ""


def why_clear(plan: "Plan") -> str:
    """Eigenproblems and doublings of clear layers."""
    reached = max((block.problem.albedo.size for block in plan.blocks), default=0)
    clear = [layer + 1 for layer in range(reached) if plan.problem.albedo[layer] == 0.0]
    return f"eigenproblem and doublings of {spelled(clear, 'layer')}: no scattering there" if clear else ""


def why_repeats(plan: "Plan") -> str:
    """Materials and slabs met before."""
    twice = {"slab" if block.choice.name == "doubling" else "layer": repeated(block) for block in plan.blocks}
    found = [counted(count, name) for name, count in twice.items() if count]
    return f"{' and '.join(found)} like another: the same material is solved once" if found else ""


def repeated(block: Block) -> int:
    """Layers of a block, or slabs that they are cut into, that need no solution of their own."""
    if block.choice.name == "doubling":
        pile = cut(block.problem)
        return int(pile.slabs.size - pile.material.size)
    materials, kinds = distinct_materials(block.problem)
    return int(kinds.size) - len(materials)


def why_doublings(plan: "Plan") -> str:
    """Doublings of slabs that are thick already."""
    thick = [
        thickness
        for block in plan.blocks
        if block.choice.name == "doubling"
        for thickness in cut(block.problem).thickness
        if SETTLES < thickness < np.inf
    ]
    return (
        "doublings of reflection once a slab passes less than the rounding of 1: its transmission alone is squared"
        if thick
        else ""
    )


def why_base(plan: "Plan") -> str:
    """Orders that the base does not reflect."""
    scene = plan.request.scene
    if plan.fed_back:
        return ""
    if not scene.base_is_reached:
        return "the base: it lies below a layer without end" if scene.base is not None else ""
    if scene.base is None:
        return "reflection by the base: it is black"
    return "reflection by the base beyond order 0 and beyond I: it reflects evenly" if plan.orders > 1 else ""


def why_azimuths(plan: "Plan") -> str:
    """Mirror images and repetitions."""
    azimuths = fold(plan.request.phi)
    count = azimuths.phi.size - azimuths.distinct.size
    return f"{count} of {azimuths.phi.size} azimuths: mirror images of others, or equal to them" if count else ""


def why_symmetric(plan: "Plan") -> str:
    """Eigenproblems that need not be general."""
    orders = [
        order
        for block in plan.blocks
        if block.choice.name == "modes" and is_symmetric(block.problem) and is_quick(block.problem, plan.accuracy)
        for order in block.orders.tolist()
    ]
    return (
        f"the general eigensolver for {spelled(orders, 'order')}: U and V do not mix, E and F are symmetric"
        if orders
        else ""
    )


def why_halves(plan: "Plan") -> str:
    """Halves of products."""
    on_processor = plan.request.backend.linear_algebra == "lapack"
    used = on_processor and any(block.choice.name == "invariance" for block in plan.blocks)
    return "half of each symmetric product of the invariance equation: the other is its mirror image" if used else ""


def why_transmission(plan: "Plan") -> str:
    """The bottom of a BRDF."""
    top_only = plan.request.kind == "brdf" and plan.request.tau.size == 1
    return "transmission: not asked for" if top_only and np.isfinite(plan.request.scene.thickness) else ""


def shared(plan: "Plan") -> list[str]:
    """What is done once for many."""
    found = []
    sides = max((block.problem.n_rhs for block in plan.blocks), default=0)
    if sides > 1:
        found.append(f"the matrices of each order: one solution for up to {sides} right-hand sides")
    scattering = [id(layer.phase_matrix) for layer in plan.request.scene.layers if layer.albedo > 0.0]
    if len(set(scattering)) < len(scattering):
        count = len(set(scattering))
        table = "phase matrix" if count == 1 else "phase matrices"
        found.append(f"single scattering: {count} {table} for {len(scattering)} layers")
    if plan.request.tau.size > 1:
        found.append(f"each order's solution: all {plan.request.tau.size} depths")
    return found


def named(stokes: Iterable[int]) -> str:
    """The letters of Stokes parameters.

    >>> named((0, 1))
    'I Q'
    """
    return " ".join("IQUV"[place] for place in sorted(stokes))


def spelled(numbers: Iterable[int], name: str) -> str:
    """Whole numbers as ranges.

    >>> spelled([0, 1, 2, 5], "order"), spelled([3], "order")
    ('orders 0-2, 5', 'order 3')
    """
    listed = sorted(set(numbers))
    return f"{name}{'s' if len(listed) != 1 else ''} {ranges(listed)}"


def ranges(listed: Sequence[int]) -> str:
    """Ascending whole numbers, neighbours drawn together."""
    starts = [k for k, number in enumerate(listed) if k == 0 or number != listed[k - 1] + 1]
    ends = [*(start - 1 for start in starts[1:]), len(listed) - 1]
    return ", ".join(
        f"{listed[a]}" if a == b else f"{listed[a]}-{listed[b]}" for a, b in zip(starts, ends, strict=True)
    )


def row_of(block: dict[str, Any]) -> tuple[str, ...]:
    """A block's cells."""
    return (
        ranges(block["orders"]),
        block["stokes"],
        str(block["nodes"]),
        str(block["layers"]) + ("" if block["bottom"] else ", no bottom"),
        str(block["unknowns"]),
        str(block["right_hand_sides"]),
        block["algorithm"],
        f"{block['operations']:.1e}",
    )


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows below each other, text to the left, numbers to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if name in LEFT else cell.rjust(width)
            for name, cell, width in zip(HEADER, row, widths, strict=True)
        ).rstrip()
        for row in rows
    ]


def section(title: str, items: Iterable[str]) -> list[str]:
    """A title and its lines, nothing without any."""
    lines = [wrapped(f"- {item}", "  ") for item in items]
    return ["", f"{title}:", *lines] if lines else []


def wrapped(text: str, indent: str = "") -> str:
    """No line longer than 120 characters."""
    return textwrap.fill(text, WIDTH, subsequent_indent=indent)


def counted(number: int, name: str) -> str:
    """A number and its noun.

    >>> counted(1, "layer"), counted(2, "layer")
    ('1 layer', '2 layers')
    """
    return f"{number} {name}{'' if number == 1 else 's'}"


def in_megabytes(size: float) -> str:
    """Three digits."""
    return f"{size / 1e6:.3g} MB"
