"""Writes what follows from stages.toml: the C struct of all arrays, the table of arguments, the stages, _core.pyi."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

DECLARED = re.compile(
    r"(double|int|complex|strided|number|whole|flag|stack|overlapping|vrte_slab)(?: \(([^)]*)\))?  (.+)", re.DOTALL
)
ARGUMENT = re.compile(r"(\w+)(\?)?(?:=(\S+))?")
C_TYPES = {"double": "double*", "int": "int*", "complex": "double*", "strided": "const char*"}
C_TYPES |= {"number": "double", "whole": "int", "flag": "int"}
FORMS = list(C_TYPES)
HINTS = {
    "double": "Array",
    "strided": "Array",
    "int": "IntArray",
    "complex": "NDArray[np.complex128]",
    "number": "float",
}
HINTS |= {"whole": "int", "flag": "bool"}
ARRAYS = ("double", "int", "complex", "strided", "stack", "overlapping", "vrte_slab")
MOST_DIMS = 6


class Argument:
    """One argument of a stage: ``form`` (of C_TYPES), ``dims``, ``words``; ``mark``: "?" where it may be left out;
    ``preset``: what it is then, or with what a result begins; whether the stage ``writes`` it."""

    def __init__(self, text: str, writes: bool, tables: list[dict[str, str]], stage: str) -> None:
        found = ARGUMENT.fullmatch(text)
        assert found, f"{stage}: {text}"
        self.name, self.mark, self.preset, self.writes = found[1], found[2], found[3], writes
        said = next((table[self.name] for table in tables if self.name in table), None)
        assert said, f"{stage}: nobody declares {self.name}"
        parts = DECLARED.fullmatch(said)
        self.form, self.words = (parts[1], parts[3]) if parts else ("whole", said)  # a size is a whole number
        self.dims = [each.strip() for each in (parts[2] or "").split(",") if each.strip()] if parts else []
        assert len(self.dims) <= MOST_DIMS, f"{stage}: {self.name}"
        assert (self.form in ARRAYS) == bool(self.dims), f"{stage}: {self.name}"

    @property
    def is_open(self) -> bool:
        return bool(self.mark or self.writes or self.preset)

    def describe(self) -> str:
        kind = {"int": "ndarray of int", "complex": "ndarray of complex", "number": "float", "whole": "int"}
        kind |= {"flag": "bool"}
        shape = f" ({', '.join(self.dims)}{',' * (len(self.dims) == 1)})" if self.dims else ""
        more = ", optional" if self.is_open else ""
        return f"{self.name} : {kind.get(self.form, 'ndarray')}{shape}{more}\n    {self.words}"


class Declarations:
    """What stages.toml says: sizes, equations between them, arrays, stages and their arguments."""

    def __init__(self, path: Path) -> None:
        said = tomllib.loads(path.read_text("utf-8"))
        self.sizes: dict[str, str] = said["sizes"]
        self.equations = [re.findall(r"\w+|[*+]", line) for line in said["equations"]["lines"]]
        self.otherwise: dict[str, int] = said["equations"]["otherwise"]
        self.stub: str = said["stub"]["functions"]
        self.stages: dict[str, Any] = said["stages"]
        self.arguments: dict[str, list[Argument]] = {}
        self.fields: dict[str, str] = dict.fromkeys(self.sizes, "whole")
        for name, stage in self.stages.items():
            tables = [stage, said["arrays"], self.sizes]
            found = [
                Argument(text, kind == "writes", tables, name)
                for kind in ("reads", "writes")
                for text in stage.get(kind, "").split()
            ]
            alone = stage.get("alone", False)  # their arguments may go by place
            self.arguments[name] = found if alone else sorted(found, key=lambda each: each.name not in self.sizes)
            for each in self.arguments[name]:
                self.add_field(name, each.name, each.form)
            for form, own, _ in self.list_scratch(name):
                self.add_field(name, own, form)
        self.kernels = {
            name: [
                Argument(text, kind == "writes", [kernel, said["arrays"], self.sizes], name)
                for kind in ("reads", "writes")
                for text in kernel.get(kind, "").split()
            ]
            for name, kernel in said["kernels"].items()
        }
        unused = said["arrays"].keys() - self.fields.keys()
        assert not unused, f"no stage takes {', '.join(sorted(unused))}"

    def add_field(self, stage: str, name: str, form: str) -> None:
        before = self.fields.setdefault(name, form)
        assert C_TYPES[before] == C_TYPES[form], f"{stage}: {name} is {before} elsewhere"

    def list_scratch(self, stage: str) -> list[tuple[str, str, str]]:
        """Form, name and size of each array of scratch memory, in sizes as Cython reads them."""
        lines = [line for line in self.stages[stage].get("scratch", "").splitlines() if line]
        found = [re.fullmatch(r"(int )?(\w+) = ([^#]*?)(?:  # .*)?", line) for line in lines]
        assert all(found), f"{stage}: {lines}"
        return [((each[1] or "double").strip(), each[2], self.read_sizes(each[3])) for each in found if each]

    def read_sizes(self, expression: str) -> str:
        return re.sub(r"\w+", lambda m: f"<size_t>t.{m[0]}" if m[0] in self.sizes else m[0], expression)

    def write_item(self, name: str) -> str:
        """What a stage does with an item: arrays begin where the item has its part, scratch memory is the thread's."""
        items, arguments = self.stages[name]["items"].split(), self.arguments[name]
        count = " * ".join(map(self.read_sizes, items)) or "1"
        scratch = self.list_scratch(name)
        doubles, ints = (
            " + ".join(size for form, _, size in scratch if form == kind) or "0" for kind in ("double", "int")
        )
        index = {each: "item" + "".join(f" // t.{after}" for after in items[k + 1 :]) for k, each in enumerate(items)}
        index = {each: f"({how}{f' % t.{each}' if k else ''})" for k, (each, how) in enumerate(index.items())}
        if "n_layer" in items:
            stacked = any(each.name == "slab_stack" for each in arguments)
            index["n_layers"] = "layer_of(t.slab_stack, t.n_layer, item)" if stacked else index["n_layer"]
        lines = []
        for each in arguments:
            if each.form not in ("double", "int", "complex") or not each.dims or each.dims[0] not in index:
                continue
            place, dims = "0", each.dims + ["2"] * (each.form == "complex")
            while dims[0:1] and dims[0] in index:
                place, dims = f"({place} * {self.read_sizes(dims[0])} + {index[dims[0]]})", dims[1:]
            step = " * ".join([f"<size_t>{place}", *map(self.read_sizes, dims)])
            known = f" if t.{each.name} != NULL else NULL" if each.mark else ""
            lines.append(f"own.{each.name} = t.{each.name} + {step}{known}")
        for kind, memory in (("double", "desk.work"), ("int", "desk.pivots")):
            for form, own, size in scratch:
                if form == kind:
                    lines.append(f"own.{own} = {memory}")
                    memory = f"own.{own} + {size}"
        body = "\n    ".join(["cdef Arrays own = t[0]", *lines, f"return {name}_one(&own, item, desk)"])
        head = f"cdef Job {name}_job(Arrays* t) noexcept nogil:\n    return Job({count}, {doubles}, {ints})\n"
        return f"{head}cdef int {name}_item(const Arrays* t, int item, Workspace desk) noexcept nogil:\n    {body}\n"

    def list_fields(self) -> list[str]:
        """Fields of the struct, sizes first."""
        found = []
        for name, form in self.fields.items():
            found.append(f"{C_TYPES[form]} {name}")
            if form == "strided":
                found.append(f"const Py_ssize_t* {name}_strides")
        return [*found, "const char* wrong"]

    def write_header(self) -> str:
        order = {name: index for index, name in enumerate(self.sizes)}
        otherwise = [str(self.otherwise.get(each, -1)) for each in order]
        rows: list[str] = []
        stages = []
        for name, arguments in self.arguments.items():
            words = self.describe(name).replace("\\", "\\\\").replace('"', '\\"').replace("\n", '\\n"\n    "')
            stages.append(f'    {{"{name}", {len(rows)}, {len(arguments)},\n    "{words}"}},')
            for each in arguments:
                dims = ", ".join(str(order[d]) if d in order else f"-({d})" for d in each.dims) or "0"
                size = order.get(each.name, -1)
                place = f"{size} * sizeof(int)" if size >= 0 else f"offsetof(vrte_arrays, {each.name})"
                facts = FORMS.index(each.form), len(each.dims), int(each.writes), int(each.is_open), size
                preset = {"True": "1", "False": "0"}.get(each.preset or "0", each.preset or "0")
                rows.append(
                    f'    {{"{each.name}", {", ".join(map(str, facts))}, {int(each.preset is not None)}, {preset},'
                    f" {{{dims}}}, {place}}},"
                )
        equations = []
        for whole, *parts in self.equations:
            factors = parts[::2]
            numbers = ", ".join(str(order[each]) if each in order else f"-{each}" for each in factors)
            equations.append(f"    {{{order[whole]}, {int('*' in parts)}, {len(factors)}, {{{numbers}}}}},")
        lines = [
            "/* Written by vrte/core/declare.py from stages.toml. */",
            "#include <stddef.h>",
            '#include "core/constants.h"',
            "typedef struct {",
            *(f"    {field};" for field in self.list_fields()),
            "} vrte_arrays;",
            "typedef struct { const char* name; int form, rank, written, open, size, has_preset; double preset;",
            f"    int dims[{MOST_DIMS}]; size_t place; }} vrte_argument;",
            "typedef struct { const char* name; int first, count; const char* words; } vrte_stage;",
            "typedef struct { int whole, is_product, count, parts[3]; } vrte_equation;",
            f"enum {{ VRTE_SIZES = {len(self.sizes)}, VRTE_EQUATIONS = {len(self.equations)} }};",
            "static const char* const vrte_size_names[] = {",
            *(f'    "{name}",' for name in self.sizes),
            "};",
            f"static const int vrte_otherwise[] = {{{', '.join(otherwise)}}};",
            "static const vrte_argument vrte_arguments[] = {",
            *rows,
            "};",
            "static const vrte_stage vrte_stages[] = {",
            *stages,
            "};",
            "static const vrte_equation vrte_equations[] = {",
            *equations,
            "};",
        ]
        return "\n".join([*lines, ""])

    def describe(self, name: str) -> str:
        """The docstring of a stage."""
        stage = self.stages[name]
        crew = [] if stage.get("alone") else ["crew : tuple\n    (threads, seconds, stop) of vrte/basics/running.py."]
        parts = [stage["does"], "Parameters\n----------", *(crew + [each.describe() for each in self.arguments[name]])]
        words = f"{parts[0]}\n\n" + "\n".join(parts[1:])
        return words + (f"\n\nReferences\n----------\n{stage['from']}." if "from" in stage else "")

    def write_struct(self) -> str:
        """The struct as Cython sees it."""
        fields = "\n        ".join(self.list_fields())
        return f'cdef extern from "arrays.h":\n    ctypedef struct Arrays "vrte_arrays":\n        {fields}\n'

    def write_stages(self) -> str:
        """Each stage as an object of the module, and what each OpenCL kernel takes."""
        stages = "".join(
            f"{name} = make_stage({index}, {name}_{'item' if 'items' in stage else 'one'}, {name}_job, "
            f"{not stage.get('alone', False)})\n"
            for index, (name, stage) in enumerate(self.stages.items())
        )
        taken = {name: [(a.name, a.form, a.dims, a.writes) for a in found] for name, found in self.kernels.items()}
        items = "".join(self.write_item(name) for name, stage in self.stages.items() if "items" in stage)
        return f"{items}{stages}KERNELS = {json.dumps(taken)!r}\n"

    def write_stub(self) -> str:
        """_core.pyi, a line a stage."""
        lines = [self.stub.strip(), "", "class Stages(Protocol):"]
        lines.append('    """The loops of a solve: those of the core, or others that stand in for them."""')
        names = []
        for name, stage in self.stages.items():
            arguments = self.arguments[name]
            hints = []
            for each in arguments:
                may_be_none = " | None" if each.mark or each.writes else ""
                preset = f" = {each.preset}" if each.preset and not each.writes else " = None" if may_be_none else ""
                hints.append(f"{each.name}: {HINTS[each.form]}{may_be_none}{preset}")
            results = [HINTS[each.form] for each in arguments if each.writes]
            result = results[0] if len(results) == 1 else "dict[str, Any]"
            start = "" if stage.get("alone") else ", crew: ThreadTeam, *"
            lines.append(f"    def {name}(self{start}, {', '.join(hints)}) -> {result}: ...")
            names.append(name)
        lines += ["", "_stages: Stages", *(f"{name} = _stages.{name}" for name in names)]
        return "\n".join([*lines, ""])


def write_if_new(path: Path, text: str) -> None:
    """A file that is as it was stays older than what was built from it."""
    if not path.is_file() or path.read_text("utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")


def declare(root: Path) -> Path:
    """Writes all that follows from the declarations; where the compiler finds it."""
    said, folder = Declarations(root / "vrte/core/stages.toml"), root / "build/core"
    write_if_new(folder / "arrays.h", said.write_header())
    write_if_new(folder / "arrays.pxi", said.write_struct())
    write_if_new(folder / "stages.pxi", said.write_stages())
    write_if_new(root / "vrte/_core.pyi", said.write_stub())
    return folder
