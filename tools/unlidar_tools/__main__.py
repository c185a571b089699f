"""The command `unlidar`, also as `python -m unlidar_tools`."""

import sys

from unlidar_tools import interrupts


def main() -> int:
    """Runs the command line in this process and returns its exit code."""
    interrupts.end_at_once()
    from unlidar_tools.cli import main as command  # takes a while

    return interrupts.guarded(command)


if __name__ == "__main__":
    sys.exit(main())
