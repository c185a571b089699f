"""docs/performance.md: its tables are made anew, its prose stays."""

import datetime
import os
import platform
import re
from pathlib import Path

from unlidar.errors import InputError


def put(page: str, part: str, table: str) -> str:
    """The page with the table between the markers of this part."""
    begin, end = f"<!-- table {part} -->\n", f"<!-- end {part} -->"
    if page.count(begin) != 1 or page.partition(begin)[2].count(end) != 1:
        raise InputError(f"the page has no {begin.strip()} ... {end}, once each")
    before, _, rest = page.partition(begin)
    return before + begin + table + end + rest.partition(end)[2]


def machine() -> str:
    """Its processor, and what of it is there."""
    info = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").is_file() else ""
    name = re.search(r"^model name\s*: (.*)$", info, re.MULTILINE)
    processor = name[1] if name else platform.machine()
    return f"{processor}, {len(os.sched_getaffinity(0))} processors, load {os.getloadavg()[0]:.1f}"


def heading(measured_on: str) -> str:
    """Stands above a table."""
    return f"*{datetime.date.today()}, {measured_on}.*\n\n"
