"""`unlidar report`: a page, figures for papers, and a rerun recording of a run."""

from pathlib import Path

from unlidar.output import write_file
from unlidar.report.data import ReportData, judged, load_run, read_results
from unlidar.report.page import page_of

PAGE = "report.html"

__all__ = ["PAGE", "ReportData", "judged", "load_run", "read_results", "write_page"]


def write_page(data: ReportData, run: Path) -> Path:
    """Writes `run`/report.html and returns its path."""
    text = page_of(data)
    # Names of the file system may be no UTF-8.
    page = text.encode("utf-8", errors="backslashreplace")
    write_file(run / PAGE, lambda work: work.write_bytes(page))
    return run / PAGE
