"""`python -m unlidar_tools.simulate.schema`: writes configs/scenarios/schema.json anew."""

import json

from unlidar_tools.configs import SCENARIO_DIR
from unlidar_tools.simulate.scenario import schema

SCHEMA = SCENARIO_DIR / "schema.json"


def text() -> str:
    """The content of the file."""
    return json.dumps(schema(), indent=1) + "\n"


if __name__ == "__main__":
    SCHEMA.write_text(text())
