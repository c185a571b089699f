"""Times of points, in whatever unit and epoch a driver writes them, relative to the frame's stamp.

The readings are those of the program: an offset from the stamp (whole numbers in nanoseconds,
others in seconds), Unix time in that unit, or Unix time in the unit of its magnitude.
"""

import numpy as np

from unlidar.stamps import NS_PER_S

TIME_FIELDS = ("t", "time", "timestamp", "offset_time")
OFFSET_FIELD = "offset_time"
# The reading is chosen on this many points; all points of a message share one.
_SAMPLE = 200
# Longest scan; times farther from the frame's stamp belong to another clock.
_FARTHEST_NS = NS_PER_S


def offsets_ns(times: np.ndarray, stamp_ns: int) -> np.ndarray | None:
    """Times of the points of a message after its stamp, (N,) int64; None if no reading fits."""
    if len(times) == 0:
        return np.zeros(0, dtype=np.int64)
    sample = times[:: max(1, len(times) // _SAMPLE)]
    if not np.isfinite(sample).all():
        return None
    base_ns = NS_PER_S if times.dtype.kind == "f" else 1
    by_magnitude_ns = _unit_ns(float(np.median(np.abs(sample.astype(float)))))
    readings = ((base_ns, 0), (base_ns, stamp_ns), (by_magnitude_ns, stamp_ns))
    distances = [
        np.median(np.abs(_ns_after(sample, *reading).astype(float))) for reading in readings
    ]
    offsets = _ns_after(times, *readings[int(np.argmin(distances))])
    return offsets if np.abs(offsets).max() <= _FARTHEST_NS else None


def pcd_column(offsets: np.ndarray) -> np.ndarray:
    """Offsets in the narrowest type a PCD file has for them: unsigned unless some are negative."""
    low, high = (int(offsets.min()), int(offsets.max())) if len(offsets) else (0, 0)
    for kind in (np.uint32, np.int32):
        if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max:
            return offsets.astype(kind)
    return offsets


def _ns_after(times: np.ndarray, unit_ns: int, epoch_ns: int) -> np.ndarray:
    """Nanoseconds after the epoch. Whole and fraction apart: doubles round Unix time to 256 ns."""
    if times.dtype.kind != "f":
        return times.astype(np.int64) * unit_ns - epoch_ns
    with np.errstate(invalid="ignore"):
        whole = np.floor(times.astype(float))
        fraction = np.rint((times - whole) * unit_ns).astype(np.int64)
        return whole.astype(np.int64) * unit_ns - epoch_ns + fraction


def _unit_ns(magnitude: float) -> int:
    for limit, unit_ns in ((1e11, NS_PER_S), (1e14, 10**6), (1e17, 10**3)):
        if magnitude < limit:
            return unit_ns
    return 1
