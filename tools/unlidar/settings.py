"""Single values of the program's configuration, as `--set section.key=value` takes them."""

import json
import math
from collections.abc import Mapping

from unlidar.call_checks import expect, is_text
from unlidar.errors import UsageError


def assignments(settings: Mapping[str, object]) -> list[str]:
    """`key=value` of each; UsageError for a value that YAML has no plain text for."""
    texts = [f"{key}={_text(key, value)}" for key, value in settings.items()]
    for text in texts:
        expect(is_text(text), "settings", text, "a text in UTF-8 without a NUL")
    return texts


def _text(key: str, value: object) -> str:
    if hasattr(value, "tolist"):  # of numpy
        value = value.tolist()
    if isinstance(value, str):
        return value
    if isinstance(value, float) and math.isinf(value):
        return ".inf" if value > 0 else "-.inf"
    try:
        return json.dumps(value)
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"settings: {key} is of type {type(value).__name__}, expected a text, a number, a bool "
            "or a list of these"
        ) from error
