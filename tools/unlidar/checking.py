"""Validation of YAML files that users write; a fault becomes one line."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass
from pydantic.json_schema import GenerateJsonSchema
from ruamel.yaml import YAMLError

from unlidar.errors import ConfigError, listed, reason
from unlidar.limits import load_yaml

T = TypeVar("T")

# Strict types: "1" is no number, 1.5 no integer.
checked = dataclass(
    frozen=True,
    config=ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    ),
)

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class _Untitled(GenerateJsonSchema):
    """Omits titles, which would only repeat the keys."""

    def field_title_should_be_set(self, _schema: object) -> bool:
        return False


def read_checked(path: Path, adapter: TypeAdapter[T]) -> T:
    """The validated content of a YAML file; ConfigError with file, key, value and expectation."""
    try:
        data = load_yaml(path)
    except (OSError, ValueError, RecursionError, YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read as YAML: {reason(error)}") from error
    try:
        # Via JSON: strict validation takes its arrays as tuples, and its keys are text.
        return adapter.validate_json(json.dumps(data, default=str))
    except ValidationError as error:
        raise ConfigError(f"{path}: {_first(error, adapter)}") from error
    except (TypeError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: expected keys with values: {reason(error)}") from error


def schema_of(adapter: TypeAdapter) -> dict:
    """The JSON schema, by which editors complete and check."""
    return adapter.json_schema(schema_generator=_Untitled)


def require(holds: bool, message: str) -> None:
    """Throws ValueError with `message`, as pydantic expects of validators, unless `holds`."""
    if not holds:
        raise ValueError(message)


# pydantic's error type -> expectation in the message.
_EXPECTED = {
    "float_type": "a number",
    "finite_number": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text",
    "tuple_type": "a list",
    "dict_type": "names with values",
    "dataclass_type": "keys with values",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number from {ge:g} on",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number up to {le:g}",
    "too_long": "{max_length} values",
}
_UNKNOWN = "unexpected_keyword_argument"


def _first(error: ValidationError, adapter: TypeAdapter) -> str:
    """The first fault on one line: the key, its value and what was expected."""
    found = error.errors(include_url=False)
    # An unknown key may be the reason why another one is missing.
    fault = next((f for f in found if f["type"] == _UNKNOWN), found[0])
    kind, value = fault["type"], fault["input"]
    *parents, last = fault["loc"] or ("",)
    if kind == _UNKNOWN:
        known = listed(_keys_of(parents, adapter))
        return f"{_spell(parents)}unknown key '{last}', expected one of {known}"
    if kind == "missing" and isinstance(last, str):
        return f"{_spell(parents)}key '{last}' is missing"
    if kind == "missing":
        return f"{_spell(parents)}'{value}', expected at least {last + 1} values"
    if kind == "value_error":
        named = parents[:-1] if last == "[key]" else fault["loc"]
        return f"{_spell(named)}{fault['ctx']['error']}"
    expected = _EXPECTED[kind].format(**fault.get("ctx", {})) if kind in _EXPECTED else fault["msg"]
    shown = "" if isinstance(value, dict | list) or value is None else f"'{value}', "
    return f"{_spell(fault['loc'])}{shown}expected {expected}"


def _spell(where: Sequence[str | int]) -> str:
    """A path of keys as `drones[0].flight: `; empty for the root."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in where)
    return f"{text.removeprefix('.')}: " if text else ""


def _keys_of(where: Sequence[str | int], adapter: TypeAdapter) -> list[str]:
    """The keys that are allowed at a path."""
    whole = schema_of(adapter)
    node = whole
    for part in where:
        inner = ("items", "additionalProperties")
        node = node.get("properties", {}).get(part) or next(node[k] for k in inner if k in node)
        node = whole["$defs"][node["$ref"].rpartition("/")[2]] if "$ref" in node else node
    return list(node["properties"])
