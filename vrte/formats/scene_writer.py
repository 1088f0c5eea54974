"""The content of a scene file as TOML that reads back the same."""

from typing import Any

from vrte.formats.toml_table import write_key, write_value


def write_toml(content: dict[str, Any]) -> str:
    """The content of a scene file as TOML: values first, then tables under headings of their own, particles under
    [particles.kind]. Raises SceneError for what no scene file holds: dates, and what is no TOML at all."""
    lines = write_lines({key: value for key, value in content.items() if not has_heading(value)})
    for key, value in content.items():
        if not has_heading(value):
            continue
        name, tables = write_key(key), value if isinstance(value, list) else [value]
        heading = f"[[{name}]]" if isinstance(value, list) else f"[{name}]"
        if key == "particles" and value and all(isinstance(inner, dict) for inner in tables[0].values()):
            for kind, table in value.items():
                lines += ["", f"[{name}.{write_key(kind)}]", *write_lines(table)]
        else:
            for table in tables:
                lines += ["", heading, *write_lines(table)]
    return "\n".join(lines).lstrip("\n") + "\n"


def write_lines(table: dict[str, Any]) -> list[str]:
    """The lines of a table below its heading."""
    return [f"{write_key(key)} = {write_value(value)}" for key, value in table.items()]


def has_heading(value: Any) -> bool:
    """Whether a value of the file is a table, or a list of tables."""
    return isinstance(value, dict) or (
        isinstance(value, list) and value != [] and all(isinstance(x, dict) for x in value)
    )
