"""What the table of an instrument means: its columns as those of a measurement, in sentences what was understood, and
what has to be asked. Nothing is guessed in silence: what the file leaves open is asked for by the keyword that says it.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vrte.appearance.geometries import read_geometry
from vrte.basics.arrays import Array, put_in_one_line, show_value
from vrte.basics.errors import SceneError
from vrte.fit.quantities import DIRECTIONS, GLOSS, INSTRUMENT, LOOK, QUANTITIES
from vrte.formats.columns import Columns
from vrte.formats.instrument_files import MISSING, is_number

UNITS = {"nm": 1e3, "um": 1.0, "1/cm": 1e4}  # to a wavelength in um; the last one is divided by the number
VALUE_UNITS = {"fraction": 1.0, "percent": 100.0}
UNIT_WORDS = {
    **dict.fromkeys(("nm", "nanometer", "nanometers", "nanometre", "nanometres"), "nm"),
    **dict.fromkeys(("um", "µm", "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres"), "um"),
    **dict.fromkeys(("cm-1", "cm^-1", "1/cm"), "1/cm"),
    **dict.fromkeys(("%", "percent", "per cent", "pct"), "percent"),
    **dict.fromkeys(("deg", "degree", "degrees", "°"), "deg"),
}
UNIT = re.compile(rf"(?:^|[\s_/(\[,])({'|'.join(map(re.escape, sorted(UNIT_WORDS, key=len, reverse=True)))})[)\]]?$")
HEADS = {  # what a column is, by the words of its head without its unit, in small letters
    "wavelength_um": "wavelength, wavelengths, lambda, λ, wl, wave, wavenumber, wavenumbers",
    "theta_i_deg": "theta_i, theta i, theta in, incidence, incidence angle, incident angle, angle of incidence",
    "theta_o_deg": "angle, theta, theta_o, theta_r, theta_s, exit angle, angle of exit, viewing angle, view angle, "
    "detector angle, detection angle, emission angle",
    "phi_deg": "phi, azimuth, azimuth angle",
    "sigma": "error, err, sigma, std, stdev, std dev, sd, standard deviation, uncertainty, ±, +/-, +-",
    "sample": "sample, sample name, sample_name, sample_id, sample id, name, id, no, no., specimen, panel",
    "base": "base, substrate, backing, background, over",
    "reflectance": "reflectance, r, refl, reflection, reflectivity, spectral reflectance",
    "reflectance_factor": "reflectance factor, brf",
    "f00": "brdf",
    "t00": "btdf",
    "degree_of_linear_polarization": "dolp, degree of polarization, degree of linear polarization",
}
ROLE_OF = {word: role for role, words in HEADS.items() for word in words.split(", ")}
COLOUR = re.compile(r"(?:cie|lab)?[\s_-]*([lab])\*?(?:[\s_]*\(.*\))?", re.IGNORECASE)
GLOSS_HEAD = re.compile(r"(?i)(?:gloss|gu)\D{0,3}(20|60|85)\b\D*|(20|60|85)\D{0,6}(?:gloss|gu)\b\D*")
TRISTIMULUS = re.compile(r"(?:cie|CIE|xyz|XYZ)?[\s_-]*([XYZ])(?:[\s_]*\(.*\))?")  # small letters are chromaticities
SPECTRAL = re.compile(r"(?:spectral[\s_]*)?(?:nm|r|w)?[\s_]*(\d{3,4}(?:\.\d+)?)\s*(?:nm)?", re.IGNORECASE)
FEWEST_SPECTRAL = 3  # columns named by wavelengths
LIGHTS = {  # in heads and preambles
    "illuminant": re.compile(r"\b(D50|D55|D65|D75|F2|F7|F11)\b"),
    "observer": re.compile(r"(?i)(?<![\d.])(10|2)\s*(?:°|deg|_degree)|observer\D{0,10}(10|2)\b"),
}
PORT = re.compile(r"(?i)\b(sci|sce|spin|spex)\b|specular[\s_]*(?:component[\s_]*)?(included|excluded)")
ANGLES = re.compile(r"(?<![\d.:/])(45[acx]?[/:]0|0[/:]45[acx]?|8[/:]d[ie]|d[ie][/:]8)(?![\d.])")
CXF_ANGLES = re.compile(r"IlluminationAngle (\d+)(?:\.0*)? MeasurementAngle (\d+)(?:\.0*)?\b")
PERCENT = re.compile(r"%\s*[RT]\b|\b[RT]\s*%|per ?cent", re.IGNORECASE)
NO_REFLECTANCE = re.compile(r"(?i)absorb|densit|k/s|log ?\(?1/r|count|intensit|transmi|radiance|%\s*T\b|^T\b")
DARKEST_WITH_MIRROR, DARKEST = 0.02, 0.0005  # the least that paints reflect: per cent of less are taken for fractions
BRIGHTEST = 1.5  # fluorescent whites
BY_SIZE = {"nm": (150.0, 2600.0), "um": (0.15, 30.0)}  # wavelengths whose unit their size tells
MOST_NAMES = 12  # that an error lists
AXES = ("wavelength_um", "theta_i_deg", "theta_o_deg", "phi_deg")
ANGLE_WORDS = {"theta_i_deg": "angles of incidence", "theta_o_deg": "angles of exit", "phi_deg": "azimuths"}
ROLES = (*AXES, "value", "sigma", "sample", "base")
ASKS = {
    "geometry": "geometry='8:di' (sphere, the surface's mirror image included), '8:de' (excluded) or '45:0' says "
    "how it was measured",
    "illuminant": "illuminant='D65', 'D50', ... says the light of the colour",
    "observer": "observer=10 or 2 says the observer of the colour",
    "theta_i_deg": "theta_i_deg=... says the angle of incidence in degrees",
    "theta_o_deg": "theta_o_deg=... says the angle of exit in degrees",
}


KEYWORDS = (  # of vrte.read_measurement
    "geometry", "illuminant", "observer", "base", "sample", "quantity", "columns", "wavelength_unit", "value_unit",
    *("theta_i_deg", "theta_o_deg", "phi_deg", "wavelength_um", "sigma"),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Series:
    """Numbers of one sample (n,): its ``name``, the ``quantity`` of each, "" where it is not known, what else is known
    of them, by columns of a measurement, and the units that heads say of values and of sigma, or ""."""

    name: str
    quantity: Sequence[str]
    value: Array
    where: dict[str, Any]
    unit: str = ""
    sigma_unit: str = ""


@dataclass
class Reading:
    """What was ``understood`` of a file, in sentences, what it ``asks``, by the keyword that answers, and the
    ``columns`` of the measurement, if nothing is asked."""

    understood: list[str] = field(default_factory=list)
    asks: dict[str, str] = field(default_factory=dict)
    columns: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return "\n".join([*self.understood, *(f"missing: {words}" for words in self.asks.values())])


class Interpreter:
    """Reads a table by its heads and the keywords ``given`` of `vrte.read_measurement`."""

    def __init__(self, table: Columns, given: Mapping[str, Any]) -> None:
        self.table, self.given, self.reading = table, given, Reading(list(table.notes))
        self.used: set[str] = set()
        self.heads = {name: split_head(name) for name in table.names}

    def get(self, name: str, *allowed: Any) -> Any:
        """A keyword that was given, one of those ``allowed``, or None; it counts as used. Raises SceneError."""
        self.used.add(name)
        value = self.given.get(name)
        if allowed and value is not None and value not in allowed:
            raise SceneError.of(name, f"must be one of {list_names(allowed)}, not {show_value(value)}")
        return value

    def say(self, words: str) -> None:
        """One more sentence, once."""
        if words not in self.reading.understood:
            self.reading.understood.append(words)

    def ask(self, keyword: str, words: str = "") -> None:
        """What is missing, by the keyword that says it."""
        self.reading.asks.setdefault(keyword, words or ASKS[keyword])

    def interpret(self) -> Reading:
        """The whole table. Raises SceneError for what is wrong; what is missing is asked for."""
        self.table.check()
        roles = self.find_roles()
        series = list(self.list_series(roles))
        if not series and not self.reading.asks:
            words = "no column is known as a wavelength, an angle or a colour"
            says = "columns={'wavelength_um': ..., 'value': ...} says which is which"
            self.ask("columns", f"{says}: {words}; there are {list_names(self.table.names)}")
        chosen = self.choose_samples(series) or series[:1]  # the first one asks what else is missing
        taken = [self.convert(one, series) for one in chosen]
        if not self.reading.asks:
            self.reading.columns = join_series(taken)
            for name in self.given:
                if name not in self.used:
                    raise SceneError.of(name, "was given, and nothing that was read needs it")
        return self.reading

    # what columns are

    def find_roles(self) -> dict[str, str]:
        """By each column's name what it is, one of ROLES, a quantity, a wavelength in nm as text; "" of any other."""
        named: dict[str, str] = {}
        for role, column in (self.get("columns") or {}).items():
            if role not in (*ROLES, *QUANTITIES):
                raise SceneError.of("columns", f"names {list_names(ROLES)} or a quantity, not {show_value(role)}")
            names = self.table.names
            name = names[column - 1] if type(column) is int and 1 <= column <= len(names) else column
            if name not in names or name in named:
                words = f"has no column {show_value(column)} for {role}, or names it twice"
                raise SceneError.of("columns", f"{words}; there are {list_names(names)}")
            named[name] = role
        roles = {name: named.get(name) or self.guess_role(name, {*named.values()}) for name in self.table.names}
        found = {*roles.values()}
        spectral = [name for name, role in roles.items() if role[:1].isdigit()]
        for name, role in roles.items():
            incomplete = any(role in one and not {*one} <= found for one in ("Lab", "XYZ") if role)
            if name not in named and (incomplete or (name in spectral and len(spectral) < FEWEST_SPECTRAL)):
                roles[name] = ""
        if not {"value", *QUANTITIES}.isdisjoint(named.values()):  # these alone
            kept = (*AXES, "sample", "base")
            roles = {name: role if name in named or role in kept else "-" for name, role in roles.items()}
        return roles

    def guess_role(self, name: str, named: set[str]) -> str:
        """What a column is by its head, where nobody says it; of roles that are ``named`` there is none more."""
        words, unit = self.heads[name]
        only_unit = "wavelength_um" if unit in UNITS and not words else ""
        if role := ROLE_OF.get(words) or ROLE_OF.get(words.replace("_", " ")) or only_unit:
            return "" if role in named else role
        if found := SPECTRAL.fullmatch(name):
            return found[1]
        if name in QUANTITIES:
            return name
        if found := GLOSS_HEAD.fullmatch(name):
            return f"gloss_{found[1] or found[2]}"
        if found := TRISTIMULUS.fullmatch(name):
            return found[1]
        found = COLOUR.fullmatch(name)
        return {"l": "L"}.get(found[1].lower(), found[1].lower()) if found else ""

    def list_series(self, roles: Mapping[str, str]) -> Iterator[Series]:
        """The samples of the table."""
        columns: dict[str, str] = {}
        for name, role in roles.items():
            if role in columns and role in (*AXES, "sample", "base"):
                words = f"{name!r} and {columns[role]!r} both look like it"
                self.ask("columns", f"columns={{{role!r}: ...}} says which column it is: {put_in_one_line(words, 200)}")
                return
            columns[role] = name
        spectral = {name: float(role) for name, role in roles.items() if role[:1].isdigit()}
        colours = [one for one in ("Lab", "XYZ") if {*one} <= {*columns}]
        glosses = [one for one in QUANTITIES if QUANTITIES[one].needs == GLOSS and one in columns]
        groups = [*colours, *(["gloss"] if glosses else [])]
        wanted = self.get("quantity", None, *QUANTITIES, *groups)
        if glosses and (wanted == "gloss" or not (wanted or spectral or colours or {*AXES} & {*columns})):
            yield from self.list_rows(columns, [columns[one] for one in glosses], glosses, {})
        elif spectral and wanted not in colours:
            if groups and not wanted:
                self.say(f"{groups[0]} stands beside the spectra: quantity={groups[0]!r} takes it")
            self.get("wavelength_unit", "nm")
            self.say(
                f"spectra in rows, wavelengths {min(spectral.values()):g} to {max(spectral.values()):g} nm in heads"
            )
            where = {"wavelength_um": [one / UNITS["nm"] for one in spectral.values()]}
            is_other = any(map(NO_REFLECTANCE.search, self.table.above))
            quantity = wanted or ("" if is_other else "reflectance")
            yield from self.list_rows(columns, [*spectral], [quantity] * len(spectral), where)
        elif colours:
            chosen = wanted if wanted in colours else colours[0]
            if chosen != colours[-1] and not wanted:
                self.say("X, Y, Z stand beside L, a, b: quantity='XYZ' takes them")
            if glosses and not wanted:
                self.say("gloss stands beside the colours: quantity='gloss' takes it")
            yield from self.list_rows(columns, [columns[one] for one in chosen], [*chosen], {})
        elif not {*AXES, *QUANTITIES}.isdisjoint(columns):
            yield from self.list_columns(roles, columns, wanted)

    def list_rows(
        self, columns: Mapping[str, str], names: Sequence[str], quantity: list[str], where: Mapping[str, list[float]]
    ) -> Iterator[Series]:
        """Samples that are rows, whose numbers stand in the columns of these names; rows of one name that differ by
        their base are one sample."""
        rows = range(len(self.table.rows))
        labels = self.table.words(columns["sample"]) if "sample" in columns else [""] * len(rows)
        bases = self.table.words(columns["base"]) if "base" in columns else None
        if bases is None:
            labels = [label or f"row {row + 1}" for row, label in enumerate(labels)]
        read = {*names, columns.get("sample"), columns.get("base")}
        if unread := [name for name in self.table.names if name not in read]:
            self.say(f"not read: {list_names(unread)}")
        unit = "percent" if any(self.heads[name][1] == "percent" for name in names) else ""
        numbers = np.array([self.read_numbers(name) for name in names])
        for label in dict.fromkeys(labels):
            own = [row for row in rows if labels[row] == label]
            if len(own) > 1 and bases is None:
                words = f"a second row of {put_in_one_line(repr(label), 40)}: names of samples must differ"
                raise self.table.fault(own[1], words)
            known: dict[str, Any] = {key: one * len(own) for key, one in where.items()}
            known |= {} if bases is None else {"base": [bases[row] for row in own for _ in names]}
            yield Series(label or "the table", quantity * len(own), numbers[:, own].T.ravel(), known, unit)

    def list_columns(
        self, roles: Mapping[str, str], columns: Mapping[str, str], wanted: str | None
    ) -> Iterator[Series]:
        """Samples that are columns, or parts of them by a column of names, beside those that say where each row was
        measured."""
        where: dict[str, Any] = {}
        for role in AXES:
            if role in columns:
                is_angle = role != "wavelength_um"
                where[role] = (self.read_numbers if is_angle else self.read_wavelengths)(columns[role])
                if is_angle:
                    self.say(f"{ANGLE_WORDS[role]} in {put_in_one_line(repr(columns[role]), 60)}, in degrees")
        if any(one is None for one in where.values()):
            return
        if "base" in columns:
            where["base"] = self.table.words(columns["base"])
        labels = self.table.words(columns["sample"]) if "sample" in columns else []
        if len({*labels}) == len(labels):  # names that all differ count the rows
            labels = [""] * len(self.table.rows)
        usual = "reflectance" if "wavelength_um" in where and "theta_o_deg" not in where else ""
        sure = ("value", *QUANTITIES)
        names = [name for name, role in roles.items() if role in sure or (not role and self.holds_numbers(name))]
        if unread := [name for name, role in roles.items() if role == "-"]:
            self.say(f"not read: {list_names(unread)}")
        if not names:
            self.ask("columns", f"columns={{'value': ...}} says which are the values: there are {list_names([*roles])}")
        bare = {name: strip_unit(name, self.heads[name][0]) for name in names}
        for name in names:
            role, follows = roles[name], next(iter([*roles][[*roles].index(name) + 1 :]), "")
            has_sigma = roles.get(follows) == "sigma"
            known = where | ({"sigma": self.read_numbers(follows)} if has_sigma else {})
            is_other = role not in QUANTITIES and any(map(NO_REFLECTANCE.search, (name, *self.table.above)))
            assumed = "" if is_other else usual
            quantity = wanted or (role if role in QUANTITIES and (role != "reflectance" or usual) else assumed)
            units = self.heads[name][1], self.heads[follows][1] if has_sigma else ""
            value = self.read_numbers(name)
            for label in dict.fromkeys(labels):
                own = [row for row, one in enumerate(labels) if one == label]
                part = {key: [column[row] for row in own] for key, column in known.items()}
                head = bare[name] if [*bare.values()].count(bare[name]) == 1 else name
                both = " ".join(filter(None, (label, head if len(names) > 1 else ""))) or head
                yield Series(both, [quantity] * len(own), value[own], part, *units)

    def holds_numbers(self, name: str) -> bool:
        """Whether a column without a known head holds numbers; what is words is said and not read."""
        if any(map(is_number, self.table.words(name))):
            return True
        self.say(f"the column {put_in_one_line(repr(name), 60)} holds no numbers and is not read")
        return False

    def read_numbers(self, name: str) -> Array:
        """The numbers of a column, NaN where nothing was measured."""
        index = self.table.names.index(name)
        for cells in self.table.rows:
            cells[index] = "" if cells[index].lower() in MISSING else cells[index]
        return self.table.numbers(name, may_be_empty=True)

    def read_wavelengths(self, name: str) -> Array | None:
        """A column of wavelengths in um; None where the unit has to be asked for."""
        found, given = self.read_numbers(name), self.get("wavelength_unit", *UNITS)
        for row in np.flatnonzero(~(found > 0.0)):
            raise self.table.fault(int(row), f"{name} must be a number above 0")
        words, unit = self.heads[name]
        told = unit if unit in UNITS else "1/cm" if words.startswith("wavenumber") else ""
        if given and told and given != told:
            raise SceneError.of("wavelength_unit", f"is {given!r}, and the head {name!r} says {told}")
        low, high = float(found.min()), float(found.max())
        size = next((unit for unit, (least, most) in BY_SIZE.items() if least <= low and high <= most), "")
        known = given or told or size
        if not known:
            words = f"{name!r} runs from {low:g} to {high:g}, which may be any of these"
            self.ask("wavelength_unit", f"wavelength_unit='nm', 'um' or '1/cm' says what wavelengths are in: {words}")
            return None
        how = "as given" if given else "by the head" if told else "by their size"
        self.say(f"wavelengths {low:g} to {high:g} {known} in {put_in_one_line(repr(name), 60)}: {how}")
        return UNITS[known] / found if known == "1/cm" else found / UNITS[known]

    # which samples, and what they hold

    def choose_samples(self, series: Sequence[Series]) -> list[Series]:
        """The samples that are taken, with their bases; none where that has to be asked for. Raises SceneError."""
        names, sample, base = [one.name for one in series], self.get("sample"), self.get("base")
        if not series:
            return []
        at = base if isinstance(base, Mapping) else {}
        over = {*at} <= {*names} and bool(at)
        taken = [one for one in series if not over or one.name in at]
        if sample is not None:
            place = int(sample) - 1 if str(sample).isdecimal() and sample not in names else None
            taken = [one for index, one in enumerate(series) if index == place or one.name == sample]
            if not taken:
                words = f"must be one of {list_names(names)}, or its number from 1, not {show_value(sample)}"
                raise SceneError.of("sample", words)
        elif not over and len({one.quantity[0] for one in taken}) < len(taken):
            one, other = (put_in_one_line(repr(name), 40) for name in names[:2])
            some = f"base={{{one}: 0.0, {other}: 0.8}} takes those of one film over several bases, by their albedos"
            self.ask("sample", f"sample={one} takes one, {some}: there are {len(names)} samples, {list_names(names)}")
            return []
        of = f", {len(taken)} of {len(names)} samples" if len(names) > 1 else ""
        self.say(f"values of {list_names([one.name for one in taken])}{of}")
        return [self.put_over(one, base, at) for one in taken]

    def put_over(self, one: Series, base: Any, at: Mapping[str, Any]) -> Series:
        """A sample whose rows know the albedos of their bases. Raises SceneError."""
        words = one.where.get("base", [one.name] * one.value.size)
        if base is None and "base" not in one.where:
            return one
        if "base" in one.where:
            if base is not None and not at:
                raise SceneError.of("base", "is a column of the file: give albedos by its words")
            albedos = [at.get(word, read_number(word)) for word in words]
        else:
            albedos = [at.get(word) for word in words] if at else [base] * len(words)
        if any(albedo is None for albedo in albedos):
            named = ", ".join(f"{word!r}: ..." for word in dict.fromkeys(words))
            self.ask("base", f"base={{{put_in_one_line(named, 200)}}} says the albedos of the bases")
            return one
        for albedo in albedos:
            if isinstance(albedo, bool) or not isinstance(albedo, int | float) or not 0.0 <= albedo <= 1.0:
                raise SceneError.of(
                    "base", f"must be an albedo from 0 to 1, or some by names, not {show_value(albedo)}"
                )
        self.say(f"{one.name!r} lies over a base of albedo {', '.join(f'{x:g}' for x in dict.fromkeys(albedos))}")
        return replace(one, where=one.where | {"base": [*map(float, albedos)]})

    def convert(self, one: Series, series: Sequence[Series]) -> Series:
        """A sample in the units of a measurement, with all that it needs. Raises SceneError."""
        quantity, count = one.quantity[0], one.value.size
        if not quantity:
            names = (
                "'reflectance_factor', 'f00'" if "theta_o_deg" in one.where else "'reflectance', 'total_transmittance'"
            )
            self.ask("quantity", f"quantity={names}, ... says what {put_in_one_line(repr(one.name), 60)} is")
            return one
        known, where, scale = QUANTITIES[quantity], dict(one.where), self.find_scale(one, series)
        if one.sigma_unit == "percent" and scale == 1.0:
            raise SceneError(f"the errors of {one.name!r} are in per cent, and its values are not", "columns")
        if "sigma" in where:
            where["sigma"] = np.asarray(where["sigma"]) / scale
        for name in (*AXES, "sigma"):
            needed = name in known.needs or name == "sigma" or (name == "wavelength_um" and not known.is_over_visible)
            if name not in where and needed and self.given.get(name) is not None:
                where[name] = [float(self.get(name))] * count
            elif name not in where and name in known.needs and name in ASKS:
                self.ask(name)
        if known.needs in (INSTRUMENT, LOOK):
            where["geometry"] = [self.find_geometry(one)] * count
        for name in LIGHTS if known.needs == LOOK else ():
            where[name] = [self.find_light(name)] * count
        kept = ~np.isnan(one.value)
        if not kept.any():
            raise SceneError(f"{put_in_one_line(repr(one.name), 60)} holds no number")
        if not kept.all():
            self.say(f"{int((~kept).sum())} rows of {one.name!r} without a number are left out")
        where = {name: np.asarray(column, object)[kept].tolist() for name, column in where.items()}
        return Series(one.name, np.asarray(one.quantity, object)[kept].tolist(), (one.value / scale)[kept], where)

    def find_scale(self, one: Series, series: Sequence[Series]) -> float:
        """What values are divided by, 100 for per cent; asked for where head, keyword and size leave it open."""
        quantity, known = one.quantity[0], QUANTITIES[one.quantity[0]]
        if known.unit != "1" or known.needs == LOOK or known.bounds[0] < 0.0:
            return 1.0
        given = self.get("value_unit", *VALUE_UNITS)
        percent = one.unit == "percent" or any(PERCENT.search(line) for line in self.table.above)
        told = "percent" if percent else "fraction" if self.table.are_fractions else ""
        if given and told and given != told:
            raise SceneError.of("value_unit", f"is {given!r}, and the file says {told}")
        largest = max(float(np.nanmax(x.value, initial=0.0)) for x in series if x.quantity[0] == quantity)
        if not given and not told:
            geometry = self.find_geometry(one) if known.needs == INSTRUMENT else ""
            if known.needs == INSTRUMENT and not geometry:
                return 1.0
            mirrors = quantity == "total_reflectance" or (bool(geometry) and read_geometry(geometry).collects)
            darkest = DARKEST_WITH_MIRROR if mirrors else DARKEST
            if largest >= 100.0 * darkest and (largest <= BRIGHTEST or known.needs == DIRECTIONS):
                words = f"values up to {largest:g} may be either"
                self.ask("value_unit", f"value_unit='fraction' or 'percent' says what values are in: {words}")
                return 1.0
        unit = given or told or ("percent" if largest > BRIGHTEST else "fraction")
        how = "as given" if given else "as the file says" if told else f"by their size, up to {largest:g}"
        words = {"percent": "per cent", "fraction": "fractions"}[unit]
        self.say(f"{quantity.replace('_', ' ')} of {put_in_one_line(repr(one.name), 60)} in {words}: {how}")
        return VALUE_UNITS[unit]

    def find_geometry(self, one: Series) -> str:
        """The geometry that was given or that the file names; "" where it has to be asked for. Raises SceneError."""
        given = self.get("geometry")
        if given is not None:
            return str(read_geometry(given).name and given)
        found = find_geometries(one.name) or find_geometries("\n".join(self.table.above))
        if len(found) == 1:
            (name,) = found
            self.say(f"geometry {name}: as the file says")
            return name
        self.ask("geometry", ASKS["geometry"] + (f": the file names {', '.join(found)}" if found else ""))
        return ""

    def find_light(self, name: str) -> Any:
        """Illuminant or observer, as given or as the file says; None where it has to be asked for."""
        given = self.get(name)
        if given is not None:
            return given
        texts = " ; ".join([*self.table.names, *self.table.above])
        found = {next(filter(None, one.groups())) for one in LIGHTS[name].finditer(texts)}
        if len(found) != 1:
            self.ask(name)
            return None
        (told,) = found
        self.say(f"{name} {told}: as the file says")
        return told if name == "illuminant" else float(told)


def split_head(name: str) -> tuple[str, str]:
    """The words of a head in small letters and its unit, "" for none.

    >>> split_head("Wavelength (nm)"), split_head("%R"), split_head("theta_o_deg"), split_head("White tile")
    (('wavelength', 'nm'), ('r', 'percent'), ('theta_o', 'deg'), ('white tile', ''))
    """
    text = name.strip().lower().replace("μ", "µ")
    if len(text) > 1 and "%" in (text[0], text[-1]) and text[-2:-1] not in ("(", "["):
        return text.strip("% _/"), "percent"
    found = UNIT.search(text)
    return (text[: found.start()].strip(" _/([,"), UNIT_WORDS[found[1]]) if found else (text, "")


def strip_unit(name: str, words: str) -> str:
    """A head without its unit, by the words that `split_head` found; as it is where there is nothing else.

    >>> strip_unit("White (%)", "white"), strip_unit("%", "")
    ('White', '%')
    """
    return name[: len(words)] if words and name.lower().startswith(words) else name


def find_geometries(text: str) -> list[str]:
    """The geometries that a text names, of those that read alike one; none for a sphere whose port is not mentioned.

    >>> find_geometries("Specular component: SCE"), find_geometries("45°/0°"), find_geometries("d/8")
    (['SCE'], ['45/0'], [])
    """
    found = [f"{light}:{eye}" for light, eye in CXF_ANGLES.findall(text)] + ANGLES.findall(text.replace("°", ""))
    found += [short.upper() or {"i": "SCI", "e": "SCE"}[word[0].lower()] for short, word in PORT.findall(text)]
    return [*{read_geometry(one).reading: one for one in found}.values()]


def read_number(cell: str) -> float | None:
    """The number of a cell, or None."""
    return float(cell.replace(",", ".")) if is_number(cell) else None


def list_names(names: Sequence[Any]) -> str:
    """Names in quotes, the first of many."""
    shown = ", ".join(put_in_one_line(repr(name), 60) for name in names[:MOST_NAMES] if name is not None)
    return shown + (f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else "")


def join_series(taken: Sequence[Series]) -> dict[str, list[Any]]:
    """The columns of a measurement of some samples, one behind another."""
    found: dict[str, list[Any]] = {"quantity": [], "value": []}
    for one in taken:
        found["quantity"] += one.quantity
        found["value"] += one.value.tolist()
    for name in dict.fromkeys(name for one in taken for name in one.where):
        empty = "" if name in ("geometry", "illuminant") else math.nan
        found[name] = [x for one in taken for x in one.where.get(name, [empty] * one.value.size)]
    return found
