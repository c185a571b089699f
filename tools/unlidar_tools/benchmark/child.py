"""The process of one job: `python -m unlidar_tools.benchmark.child`, started by a Launcher."""

import sys

from unlidar_tools.benchmark.job import do
from unlidar_tools.processes import serve

if __name__ == "__main__":
    sys.exit(serve(do))
