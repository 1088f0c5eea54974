"""Tables as instruments write them: numbers below a preamble of any words, CGATS.17 and CxF3.

What the columns mean is known above, vrte/fit/instruments.py. CGATS.17 is read by its keywords, CxF3 by its elements,
ISO 17972-1; both from public files, not from the standards.
"""

import csv
import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from xml.etree import ElementTree

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import SceneError
from vrte.formats.columns import SEPARATORS, Columns, list_lines, split_cells

LARGEST_FILE = 20_000_000  # characters
MOST_ROWS = 200_000
COMMENTS = "#", "%", "//", "!"
MISSING = {"", "-", "--", "nan", "n/a", "na", "****"}  # cells of rows where nothing was measured
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)(e[+-]?\d+)?", re.IGNORECASE)
UNIT = re.compile(r"[(\[]?(nm|um|µm|μm|cm-1|1/cm|%|deg|°|-|1|a\.?u\.?|)[)\]]?", re.IGNORECASE)
PAIRED = "SPECTRAL_PCT", "SPECTRAL_DEC"  # of CGATS, behind SPECTRAL_NM: per cent, fractions
WORD = re.compile(r'"([^"]*)"|(\S+)')  # of CGATS
SHOWN = 40  # characters of a file that an error shows
ENCODINGS = {"utf-8-sig": "UTF-8", "utf-16": "UTF-16", "utf-16-le": "UTF-16", "utf-16-be": "UTF-16"}
SEPARATED = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "white space"}


def find_table(text: str, encoding: str) -> Columns:
    """The table of an instrument's file, by its text. Raises SceneError."""
    if len(text) > LARGEST_FILE:
        raise SceneError(f"the file is longer than {LARGEST_FILE} characters")
    is_cgats = re.search(r"^\s*BEGIN_DATA_FORMAT\b", text, re.MULTILINE)
    parse = parse_cxf if text.lstrip().startswith("<") else parse_cgats if is_cgats else find_run
    table = parse(text)
    if len(table.rows) > MOST_ROWS:
        raise SceneError(f"the table must have at most {MOST_ROWS} rows, not {len(table.rows)}")
    table.notes[:0] = [f"text in {ENCODINGS.get(encoding, 'Latin-1 (Windows)')}"]
    return table


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, with a decimal point or a decimal comma."""
    return NUMBER.fullmatch(cell) is not None


def count_numbers(cells: Sequence[str]) -> int:
    """How many more cells hold numbers than words; at least two cells make a row."""
    words = [cell for cell in cells if not is_number(cell) and cell.lower() not in MISSING]
    return sum(map(is_number, cells)) - len(words) if len(cells) > 1 else 0


Split = list[tuple[int, str, list[str]]]  # number, text and cells of lines


def split_lines(text: str, separator: str) -> Split:
    """Lines and their cells; none where a line has no such."""

    def split(line: str) -> list[str]:
        try:
            return split_cells(line, separator)
        except csv.Error:
            return []

    return [(number, line, split(line)) for number, line in list_lines(text)]


def find_longest(lines: Split) -> tuple[int, int, int]:
    """Weight (numbers less words), first and end index of the longest run of lines with equally many cells."""
    best, start = (0, 0, 0), 0
    weights = [0 if line.lstrip().startswith(COMMENTS) else count_numbers(cells) for _, line, cells in lines]
    for end in range(1, len(lines) + 1):
        is_end = end == len(lines) or weights[end] <= 0 or len(lines[end][2]) != len(lines[start][2])
        if is_end or weights[start] <= 0:
            weight = sum(weights[start:end]) if weights[start] > 0 else 0
            best, start = max(best, (weight, start, end), key=lambda one: one[0]), end
    return best


def find_run(text: str) -> Columns:
    """The longest run of rows of numbers under its names. Raises SceneError for none, and for such rows outside it."""
    found = [(one, split_lines(text, one)) for one in SEPARATORS]
    separator, lines = max(found, key=lambda one: find_longest(one[1])[0])
    weight, start, end = find_longest(lines)
    if not weight:
        words = f"it begins with {put_in_one_line(lines[0][1], SHOWN)!r}" if lines else "it is empty"
        raise SceneError(f"no table of numbers was found: {words}")
    width = len(lines[start][2])
    for index in (*range(start - 2, -1, -1), *range(end, len(lines))):
        if len(lines[index][2]) == width and count_numbers(lines[index][2]) == width:
            number, line, _ = lines[end if index >= end else start - 1]
            words = f"is no row of {width} numbers, as those before and behind it are"
            raise SceneError(f"line {number}: {put_in_one_line(line.strip(), SHOWN)!r} {words}: a file holds one table")
    rows = [cells for _, _, cells in lines[start:end]]
    names, first = find_names(lines, start, separator)
    if not names:  # wavelengths may be the first row of numbers
        numbers = [float(cell.replace(",", ".")) for cell in rows[0] if is_number(cell)]
        if len(rows) > 1 and len(numbers) > 2 and min(numbers) >= 150.0 and numbers == sorted({*numbers}):
            names, rows, start = rows[0], rows[1:], start + 1
        else:
            names = [f"column {index}" for index in range(1, width + 1)]
    numbers_of_lines, above = [number for number, _, _ in lines[start:end]], [line for _, line, _ in lines[:first]]
    columns = list(zip(names, *rows, strict=True))
    kept = [k for k, column in enumerate(columns) if any(column)]
    # where each sample has its wavelengths beside it, they are taken once
    kept = [k for k in kept if k == kept[0] or columns[k] != columns[kept[0]]]
    taken = [names[k] for k in kept], [[row[k] for k in kept] for row in rows]
    table = Columns(*taken, numbers_of_lines, separator, above)
    below = lines[end:]
    commas = separator != "," and any("," in cell for row in rows for cell in row if is_number(cell))
    table.notes += [
        f"rows in lines {numbers_of_lines[0]} to {numbers_of_lines[-1]}, columns by {SEPARATED[separator]}"
        + ", decimal commas" * commas,
        *(["the words above the table are not read as numbers"] if first else []),
        *([f"what stands below the table, from line {below[0][0]} on, is not read"] if below else []),
    ]
    return table


def find_names(lines: Split, start: int, separator: str) -> tuple[list[str], int]:
    """Names of columns above a table, with units and samples, and the index of their first line; [] for none."""
    width = len(lines[start][2])

    def read(index: int) -> list[str]:
        if index < 0:
            return []
        line = lines[index][1].strip().lstrip("#%!/").strip()
        ways = [
            lines[index][2] if line == lines[index][1].strip() else split_lines(line, separator)[0][2] if line else []
        ]
        if separator == " ":  # names may hold blanks
            ways += [re.split(r"\s{2,}|\t", line), re.findall(r"\S+(?:\s+[(\[][^)\]]*[)\]])?", line)]
        return next((cells for cells in ways if len(cells) == width and not all(map(is_number, cells))), [])

    first, names = start - 1, read(start - 1)
    if names and all(UNIT.fullmatch(name) for name in names) and any(names) and read(first - 1):
        first -= 1
        names = [
            f"{name} ({unit.strip('()[]')})" if unit else name for name, unit in zip(read(first), names, strict=True)
        ]
    if any(names.count(name) > 1 for name in names if name) and read(first - 1):
        first, sample, merged = first - 1, "", []
        for one, name in zip(read(first), names, strict=True):
            sample = one or sample
            repeats = name and name != names[0] and names.count(name) > 1
            merged.append(f"{sample} {name}".strip() if repeats else name)
        names = merged
    return names, max(first, 0) if names else start


def parse_cgats(text: str) -> Columns:
    """The table of a CGATS.17 file. Raises SceneError."""
    lines = [(number, line) for number, line in list_lines(text) if not line.lstrip().startswith("#")]
    parts: dict[str, list[tuple[int, str]]] = {"": [], "BEGIN_DATA_FORMAT": [], "BEGIN_DATA": []}
    here = ""
    for number, line in lines:
        first, _, rest = line.strip().partition(" ")
        if first in ("BEGIN_DATA_FORMAT", "BEGIN_DATA"):
            if parts[first]:
                raise SceneError(f"line {number}: a second {first}: a file holds one table")
            here, line = first, rest
        elif first in ("END_DATA_FORMAT", "END_DATA"):
            here = ""
            continue
        parts[here] += [(number, quoted or plain) for quoted, plain in WORD.findall(line)] if here else [(number, line)]
    names = [word for _, word in parts["BEGIN_DATA_FORMAT"]]
    cells = parts["BEGIN_DATA"]
    if not names or not cells or len(cells) % len(names):
        words = f"{len(cells)} values in BEGIN_DATA must be a multiple of the {len(names)} names in BEGIN_DATA_FORMAT"
        raise SceneError(f"CGATS: {words}, and not 0")
    sets = range(0, len(cells), len(names))
    rows = [[word for _, word in cells[index : index + len(names)]] for index in sets]
    above, values = [line for _, line in parts[""]], {*PAIRED} & {*names}
    if "SPECTRAL_PCT" in values:
        above.append("SPECTRAL_PCT: per cent")
    names, rows = join_pairs(names, rows)
    notes, fractions = [f"CGATS.17, {len(rows)} samples"], values == {"SPECTRAL_DEC"}
    return Columns(names, rows, [cells[index][0] for index in sets], " ", above, notes, are_fractions=fractions)


def join_pairs(names: list[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    """Columns where spectra are pairs of a wavelength [nm] and a value, as columns named by wavelengths. Raises
    SceneError where samples have other wavelengths.

    >>> join_pairs(["SPECTRAL_NM", "SPECTRAL_PCT"], [["400", "61.5"], ["400", "63.0"]])
    (['400 nm'], [['61.5'], ['63.0']])
    """
    found = list(names)
    pairs = [k for k, (name, value) in enumerate(pairwise(names)) if name == "SPECTRAL_NM" and value in PAIRED]
    for k in pairs:
        wavelengths = {row[k] for row in rows}
        if len(wavelengths) > 1:
            words = (
                f"wavelengths of one column must be the same in all samples, not {', '.join(sorted(wavelengths)[:3])}"
            )
            raise SceneError(f"CGATS: {words}")
        found[k + 1] = f"{wavelengths.pop()} nm"
    kept = [k for k in range(len(names)) if k not in pairs]
    return [found[k] for k in kept], [[row[k] for k in kept] for row in rows]


def parse_cxf(text: str) -> Columns:
    """Reflectance spectra and CIELAB of all objects of a CxF3 file, a row an object. Raises SceneError."""
    if re.search(r"<!(DOCTYPE|ENTITY)", text):
        raise SceneError("CxF: a document type is not read")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise SceneError(f"CxF: no XML ({put_in_one_line(str(error), 100)})") from error

    def find(element: ElementTree.Element, *names: str) -> Iterator[ElementTree.Element]:
        return (one for one in element.iter() if one.tag.rpartition("}")[2] in names)

    steps = {
        one.get("Id"): part.get("Increment")
        for one in find(root, "ColorSpecification")
        for part in find(one, "WavelengthRange")
    }
    found: list[dict[str, str]] = []
    used: list[str | None] = []
    for index, one in enumerate(find(root, "Object"), 1):
        cells = {"sample": one.get("Name") or one.get("Id") or f"object {index}"}
        for part in find(one, "ReflectanceSpectrum", "ColorCIELab"):
            specification = part.get("ColorSpecification")
            used.append(specification)
            if part.tag.endswith("ColorCIELab"):
                cells |= {f"{name}*": next((x.text or "" for x in find(part, name.upper())), "") for name in "Lab"}
                continue
            begin, step = part.get("StartWL"), part.get("Increment") or steps.get(specification)
            values = (part.text or "").split()
            if not begin or not begin.isdecimal() or not (step or "").isdecimal() or not int(step or 0):
                raise SceneError(f"CxF: the spectrum of {cells['sample']!r} lacks its StartWL or its Increment")
            cells |= {f"{int(begin) + k * int(step or 0)} nm": value for k, value in enumerate(values)}
        if len(cells) > 1:
            found.append(cells)
    if not found:
        raise SceneError("CxF: no object has a ReflectanceSpectrum or a ColorCIELab")
    names = [*dict.fromkeys(name for cells in found for name in cells)]
    above = [
        " ".join(" ".join(" ".join((part.tag.rpartition("}")[2], part.text or "")).split()) for part in one.iter())
        for one in find(root, "ColorSpecification")
        if one.get("Id") in used
    ]
    rows = [[cells.get(name, "").strip() for name in names] for cells in found]
    return Columns(names, rows, [0] * len(rows), " ", above, [f"CxF3, {len(rows)} objects"], are_fractions=True)
