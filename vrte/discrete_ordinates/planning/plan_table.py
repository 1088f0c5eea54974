"""A plan in words and numbers: a short table, what is left out and why, what is shared, predicted work and memory."""

import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.memory import BYTES
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.routes import OTHER, ROUTES
from vrte.discrete_ordinates.orders.skip_flags import SkipFlags
from vrte.discrete_ordinates.planning.azimuths import fold_azimuths
from vrte.discrete_ordinates.planning.blocks import Block, explain_normal
from vrte.discrete_ordinates.planning.memory import count_doubles_needed, count_doubles_of_kernels
from vrte.discrete_ordinates.planning.operations import (
    count_operations_of_block,
    count_operations_of_flakes,
    count_operations_of_plan,
    count_operations_of_sums,
)
from vrte.discrete_ordinates.planning.order_bounds import ORDERS, explain_stokes_sets
from vrte.request.how import EXACT
from vrte.scene.scene import Scene

if TYPE_CHECKING:
    from vrte.discrete_ordinates.planning.plan import Plan

HEADER = ("orders", "Stokes", "layers", "unknowns", "right-hand sides", "algorithm", "operations")
LEFT = ("orders", "Stokes", "algorithm")  # columns of text
SWITCHES = (*(switch.name for switch in fields(SkipFlags)), "transmission")
OF_BLOCKS = {  # what blocks and their algorithms give reasons for
    "columns": "right-hand sides without light: {}",
    "depth": "what no light comes back from: {}",
    "repeats": "{} like another: the same material is solved once",
    "doublings": "doublings of reflection once a slab passes less than the rounding of 1: {}",
    "symmetric": "the general eigensolver for {}: U and V do not mix, E and F are symmetric",
    "halves": "half of each symmetric product of the invariance equation: {}",
    "coarse": "a third of the steps of the invariance equation on all nodes: {}",
}
WIDTH = 120


def write_plan(plan: "Plan") -> str:
    """The whole, lines of at most 120 characters."""
    if plan.parts:
        texts = [f"Light that comes in {kind}, by itself:\n{write_plan(part)}" for kind, part in name_parts(plan)]
        return "\n\n".join(texts + (["\n".join(write_derivatives(plan)).strip()] if plan.derivatives else []))
    if is_another_method(plan):
        return "\n".join([*write_head(plan), "", wrap_line(f"{plan.request.method}: {plan.request.method_rule}")])
    facts = plan.as_dict()
    rows = [write_block_row(block) for block in facts["blocks"]]
    lines = [*write_head(plan), "", *arrange_rows([HEADER, *rows]), ""]
    lines += [wrap_line(reason) for reason in explain_algorithms(facts["blocks"])]
    lines += [wrap_line(text) for text in list_remarks(plan)]
    lines += write_section("Left out", facts["left_out"].values())
    lines += write_section("Shared", facts["shared"])
    lines += [
        "",
        f"Predicted: {facts['operations']:.1e} operations, {write_megabytes(facts['memory_bytes'])} of memory",
        *write_derivatives(plan),
    ]
    return "\n".join(lines)


def write_derivatives(plan: "Plan") -> list[str]:
    """What is differentiated, how, and what that takes beside the light itself; nothing where nothing is."""
    facts = list_derivative_facts(plan)
    if not facts:
        return []
    named = write_section("Derivatives", (f"{one.name}: {one.how}" for one in plan.derivatives))
    reported = (
        f"{facts['operations_of_derivatives']:.1e} operations more, about {facts['solves_of_derivatives']:.3g} times"
    )
    kept = write_megabytes(facts["memory_bytes_of_derivatives"])
    return [*named, "", f"Predicted for derivatives: {reported} those of the light, {kept} of memory more"]


def list_derivative_facts(plan: "Plan", operations: float | None = None) -> dict[str, Any]:
    """The same as numbers and strings; ``operations`` of the plan, where they are known."""
    if not plan.derivatives:
        return {}
    if operations is None:
        operations = count_operations_of_plan(plan)
    solves = sum(one.solves for one in plan.derivatives)
    return {
        "derivatives": {one.name: one.how for one in plan.derivatives},
        "solves_of_derivatives": solves,
        "operations_of_derivatives": solves * operations,
        "memory_bytes_of_derivatives": count_bytes_of_derivatives(plan),
    }


def count_bytes_of_derivatives(plan: "Plan") -> float:
    """Of what derivatives keep: a result each, and by the algebra the light of all its orders."""
    result = plan.wanted.doubles(plan.request.phi.size)
    kernels = sum(count_doubles_of_kernels(block) for part in plan.parts or (plan,) for block in part.blocks)
    return BYTES * sum(result + (0.0 if one.how.startswith("differences") else kernels) for one in plan.derivatives)


def list_plan_facts(plan: "Plan") -> dict[str, Any]:
    """The same as numbers and strings, for programs."""
    if plan.parts:
        parts = {kind: list_plan_facts(part) for kind, part in name_parts(plan)}
        asked = {"kind": plan.request.kind, "accuracy": plan.request.accuracy, "threads": plan.threads}
        return asked | {"parts": parts} | list_derivative_facts(plan)
    if is_another_method(plan):
        asked = {"kind": plan.request.kind, "accuracy": plan.request.accuracy, "threads": plan.threads}
        return asked | {"method": plan.request.method, "method_rule": plan.request.method_rule}
    request, problem = plan.request, plan.problem
    blocks = [list_block_facts(plan, block) for block in plan.blocks]
    result = plan.wanted.doubles(request.phi.size)
    doubles = count_doubles_needed(problem, plan.blocks, result, plan.azimuths, plan.threads)
    sums = count_operations_of_sums(plan) + count_operations_of_flakes(problem)
    operations = sums + sum(block["operations"] for block in blocks)
    found = {
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
        "left_out": explain_left_out(plan),
        "shared": list_shared_work(plan),
        "notes": list(plan.notes),
        "operations": operations,
        "memory_bytes": BYTES * doubles,
    }
    return found | list_derivative_facts(plan, operations)


def is_another_method(plan: "Plan") -> bool:
    """Whether the rules of "auto" took a method that has no such plan."""
    return bool(plan.request.method_rule) and plan.request.method != EXACT


def name_parts(plan: "Plan") -> list[tuple[str, "Plan"]]:
    """The plans of light that comes in unpolarized, and polarized, where they differ."""
    return list(zip(("unpolarized", "polarized"), plan.parts, strict=True))


def list_block_facts(plan: "Plan", block: Block) -> dict[str, Any]:
    """A block's row."""
    return {
        "orders": block.orders.tolist(),
        "stokes": name_stokes(block.stokes),
        "layers": int(block.problem.albedo.size),
        "bottom": bool(np.isfinite(block.problem.thickness[-1])),
        "unknowns": block.problem.size,
        "right_hand_sides": block.problem.n_rhs,
        "algorithm": block.choice.name,
        "reason": block.choice.reason,
        "operations": count_operations_of_block(block, plan.needs.strength[0, block.orders], plan.accuracy),
    }


def write_head(plan: "Plan") -> list[str]:
    """What is asked for."""
    request, base = plan.request, plan.diagnostics()["base"]
    layers = write_count(len(request.scene.layers), "layer")
    refracting = sum(interface is not None for interface in request.scene.interfaces)
    layers += f", {write_count(refracting, 'interface')}" if refracting else ""
    into, out, depths = request.mu0.size, plan.mu.size, write_count(request.tau.size, "depth")
    if request.kind == "brdf":
        out //= request.tau.size
        asked = (
            f"{into} mu_i, {out} mu_o, {request.phi.size} phi, {'with' if request.tau.size > 1 else 'no'} transmission"
        )
    elif request.fluxes_only:
        asked = f"fluxes alone, {depths}"
    else:
        asked = f"{write_count(into, 'beam')}, {depths}, {out} mu, {request.phi.size} phi"
    accuracy = f"accuracy {request.accuracy:g} of the largest I"
    backend = request.backend
    threads = write_count(plan.threads, "thread") if backend.label == "openmp" else f"backend {backend.label}"
    return [
        f"Plan of {request.kind}: {layers}, base {base}; {accuracy}, {plan.problem.nodes.size} nodes, {threads}",
        asked,
    ]


def explain_algorithms(blocks: Sequence[dict[str, Any]]) -> list[str]:
    """Why each algorithm was taken; the first of reasons that differ in their numbers alone."""
    alike: dict[str, list[str]] = {}
    for block in blocks:
        reason = f"{block['algorithm']}: {block['reason']}"
        alike.setdefault(re.sub(r"[0-9]\S*", "", reason), []).append(reason)
    return [f"{found[0]}{' (the first of these blocks)' if len(set(found)) > 1 else ''}" for found in alike.values()]


def list_remarks(plan: "Plan") -> list[str]:
    """What may happen besides."""
    request = plan.request
    chosen = request.nodes is None or bool(request.method_rule)
    found = [request.method_rule] if request.method_rule else []
    found += [f"nodes: {plan.choice.rule}", *plan.notes] if chosen else [*plan.notes]
    for number, shares in plan.diagnostics().get("facets_send_on", {}).items():
        known = [fraction for fraction in shares if fraction is not None]
        found.append(
            f"facets of rough interface {number} send on {min(known):.3g} to {max(known):.3g} of a beam's light; what "
            "is missing is lost between facets, what is beyond 1 gained where they cast no shadows"
        )
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


def explain_left_out(plan: "Plan") -> dict[str, str]:
    """What is not done, by the name of its switch, and why: as the plan, its blocks and their algorithms say."""
    of_blocks: dict[str, dict[str, set[int]]] = {}
    for block in plan.blocks:
        by_route = ROUTES[block.choice.name].list_left_out(block.problem, plan.accuracy)
        for name, reason in [*explain_block(plan.problem, block), *by_route]:
            of_blocks.setdefault(name, {}).setdefault(reason, set()).update(block.orders.tolist())
    found = {}
    for name, reasons in of_blocks.items():
        texts = [reason.format(orders=write_numbers(orders, "order")) for reason, orders in reasons.items()]
        found[name] = OF_BLOCKS[name].format("; ".join(texts))
    found |= explain_whole_plan(plan)
    return {name: found[name] for name in SWITCHES if found.get(name) and getattr(plan.problem.skip_flags, name, True)}


def explain_block(problem: Problem, block: Block) -> list[tuple[str, str]]:
    """What a block leaves out of the problem: the name of a switch and the reason, with {orders} in the place of the
    block's."""
    layers, n_col, reached = problem.albedo.size, problem.columns.shape[0], block.problem.albedo.size
    ends_early = np.isinf(block.problem.thickness[-1]) and (reached < layers or np.isfinite(problem.thickness[-1]))
    reasons = (
        (len(block.columns) < n_col, "columns", f"of {n_col} incident Stokes columns each block takes its own alone"),
        (reached < layers, "depth", f"below layer {reached} of {layers} for {{orders}}"),
        (ends_early, "depth", "the bottom of the last layer reached, optically infinite for {orders}"),
    )
    return [(name, reason) for holds, name, reason in reasons if holds]


def explain_whole_plan(plan: "Plan") -> dict[str, str]:
    """What is left out of the whole, "" where it is not."""
    request, problem, scene = plan.request, plan.problem, plan.request.scene
    found, last = {}, problem.coefficients.shape[1] - 1
    if request.fluxes_only and problem.skip_flags.fluxes and not plan.base_couples_orders:
        found["fluxes"] = "all orders but 0: fluxes alone are asked for"
    elif plan.orders <= last:
        beyond = write_numbers(range(plan.orders, last + 1), "order")
        found["orders"] = f"multiple scattering of {beyond}: together they add less than {ORDERS:g} of the accuracy"
    if {block.stokes for block in plan.blocks} - {ALL} and not plan.base_couples_orders:
        found["stokes"] = explain_stokes_sets(problem, any(block.orders[0] == 0 for block in plan.blocks))
    if request.kind == "radiance" and request.columns.shape[0] == 1:
        dark, part = ("I, Q", 1) if request.columns[0, 2:].any() else ("U, V", 2)
        found["columns"] = f"right-hand sides of light that comes in as {dark}: there is none (no k = {part} part)"
    terms = [layer.phase_matrix.terms for layer in scene.layers if layer.albedo > 0.0]
    if terms and not request.fluxes_only:
        closed = f"all {max(terms)} in closed form, at the scattering angle of every pair"
        found["single"] = f"single scattering order by order: {closed}"
    if plan.orders > 1 and not request.fluxes_only:
        found["normal"] = explain_normal(problem)
    reached = max((block.problem.albedo.size for block in plan.blocks), default=0)
    if clear := [layer + 1 for layer in range(reached) if problem.albedo[layer] == 0.0]:
        found["clear"] = f"eigenproblem and doublings of {write_numbers(clear, 'layer')}: no scattering there"
    if not plan.base_couples_orders:
        found["base"] = explain_base(scene, plan.orders)
    if repeated := request.phi.size - fold_azimuths(request.phi).distinct.size:
        found["azimuths"] = f"{repeated} of {request.phi.size} azimuths: mirror images of others, or equal to them"
    if request.kind == "brdf" and request.tau.size == 1 and np.isfinite(scene.thickness):
        found["transmission"] = "transmission: not asked for"
    if request.backend.linear_algebra == "device":
        found["halves"] = found["coarse"] = ""
    return found


def explain_base(scene: Scene, orders: int) -> str:
    """What the base does not reflect."""
    if not scene.base_is_reached:
        return "" if scene.base is None else "the base: it lies below a semi-infinite layer"
    if scene.base is None:
        return "reflection by the base: it is black"
    return "reflection by the base beyond order 0 and beyond I: it reflects evenly" if orders > 1 else ""


def list_shared_work(plan: "Plan") -> list[str]:
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


def name_stokes(stokes: Iterable[int]) -> str:
    """The letters of Stokes parameters.

    >>> name_stokes((0, 1))
    'I Q'
    """
    return " ".join("IQUV"[index] for index in sorted(stokes))


def write_numbers(numbers: Iterable[int], name: str) -> str:
    """Whole numbers as ranges.

    >>> write_numbers([0, 1, 2, 5], "order"), write_numbers([3], "order")
    ('orders 0-2, 5', 'order 3')
    """
    listed = sorted(set(numbers))
    return f"{name}{'s' if len(listed) != 1 else ''} {write_ranges(listed)}"


def write_ranges(listed: Sequence[int]) -> str:
    """Ascending whole numbers, neighbours drawn together."""
    starts = [k for k, number in enumerate(listed) if k == 0 or number != listed[k - 1] + 1]
    ends = [*(start - 1 for start in starts[1:]), len(listed) - 1]
    return ", ".join(
        f"{listed[a]}" if a == b else f"{listed[a]}-{listed[b]}" for a, b in zip(starts, ends, strict=True)
    )


def write_block_row(block: dict[str, Any]) -> tuple[str, ...]:
    """A block's cells."""
    return (
        write_ranges(block["orders"]),
        block["stokes"],
        str(block["layers"]) + ("" if block["bottom"] else ", no bottom"),
        str(block["unknowns"]),
        str(block["right_hand_sides"]),
        block["algorithm"],
        f"{block['operations']:.1e}",
    )


def arrange_rows(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows below each other, text to the left, numbers to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if name in LEFT else cell.rjust(width)
            for name, cell, width in zip(HEADER, row, widths, strict=True)
        ).rstrip()
        for row in rows
    ]


def write_section(title: str, items: Iterable[str]) -> list[str]:
    """A title and its lines, nothing without any."""
    lines = [wrap_line(f"- {item}", "  ") for item in items]
    return ["", f"{title}:", *lines] if lines else []


def wrap_line(text: str, indent: str = "") -> str:
    """No line longer than 120 characters."""
    return textwrap.fill(text, WIDTH, subsequent_indent=indent)


def write_count(number: int, name: str) -> str:
    """A number and its noun.

    >>> write_count(1, "layer"), write_count(2, "layer")
    ('1 layer', '2 layers')
    """
    return f"{number} {name}{'' if number == 1 else 's'}"


def write_megabytes(size: float) -> str:
    """A number of bytes in megabytes, to three digits."""
    return f"{size / 1e6:.3g} MB"
