"""The process of one job: `python -m unlidar.benchmark.child`, started by a Launcher."""

import sys

from unlidar.benchmark.job import do
from unlidar.processes import serve

if __name__ == "__main__":
    sys.exit(serve(do))
