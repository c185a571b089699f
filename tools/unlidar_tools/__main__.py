"""`python -m unlidar_tools` is the command `unlidar`."""

import sys

from unlidar_tools.cli import main

sys.exit(main())
