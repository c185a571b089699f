"""The command `unlidar`, also as `python -m unlidar`."""

import sys

from unlidar import interrupts


def main() -> int:
    """Runs the command line in this process and returns its exit code."""
    interrupts.end_at_once()
    from unlidar.cli import main as command  # takes a while

    return interrupts.guarded(command)


if __name__ == "__main__":
    sys.exit(main())
