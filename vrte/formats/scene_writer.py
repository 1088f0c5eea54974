"""The content of a scene file as TOML that reads back the same."""

from typing import Any

from vrte.formats.toml_table import write_key, write_value


def write_toml(content: dict[str, Any]) -> str:
    """The content of a scene file as TOML: values first, then tables under headings of their own, particles under
    [particles.kind]. Raises SceneError for what no scene file holds: dates, and what is no TOML at all."""
    headed = {key: value for key, value in content.items() if are_tables(value if isinstance(value, list) else [value])}
    lines = write_lines({key: value for key, value in content.items() if key not in headed})
    for key, value in headed.items():
        name = write_key(key)
        if isinstance(value, list):
            tables = [(f"[[{name}]]", table) for table in value]
        elif key == "particles" and are_tables([*value.values()]):
            tables = [(f"[{name}.{write_key(kind)}]", table) for kind, table in value.items()]
        else:
            tables = [(f"[{name}]", value)]
        for heading, table in tables:
            lines += ["", heading, *write_lines(table)]
    return "\n".join(lines).lstrip("\n") + "\n"


def write_lines(table: dict[str, Any]) -> list[str]:
    """The lines of a table below its heading."""
    return [f"{write_key(key)} = {write_value(value)}" for key, value in table.items()]


def are_tables(values: list[Any]) -> bool:
    """Whether values of the file are tables, at least one."""
    return bool(values) and all(isinstance(value, dict) for value in values)
