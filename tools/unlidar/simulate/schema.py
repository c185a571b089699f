"""`python -m unlidar.simulate.schema`: writes configs/scenarios/schema.json anew."""

import json

from unlidar.configs import SCENARIO_DIR
from unlidar.simulate.scenario import schema

SCHEMA = SCENARIO_DIR / "schema.json"


def text() -> str:
    """The content of the file."""
    return json.dumps(schema(), indent=1) + "\n"


if __name__ == "__main__":
    SCHEMA.write_text(text())
