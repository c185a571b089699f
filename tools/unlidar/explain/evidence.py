"""Evidence of a target after each stage of the program, second by second."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from unlidar.errors import InputError, listed
from unlidar.explain.stream_tracks import StreamTracks
from unlidar.explain.targets import Reach, Target
from unlidar.explain.trace import TracedDetection, TracedFrame, TracedPath, TracedTrack
from unlidar.mounting import Mounting
from unlidar.stamps import format_stamp_ns
from unlidar.truth import Tracks

SECOND_NS = 1_000_000_000
BELOW_THRESHOLD = "below_threshold"  # name of a rejection rule of the program


@dataclass(frozen=True)
class PathThere:
    """The part of a path that lies at the target."""

    detections: int  # of the path, at the target
    log_likelihood_ratio: float
    crowding_penalty: float
    threshold: float
    rejection: str | None

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """Sort key: higher for paths that passed more rules; the threshold is the first."""
        margin = self.log_likelihood_ratio - self.threshold
        return self.rejection is None, self.rejection != BELOW_THRESHOLD, margin


@dataclass
class Evidence:
    """Counts within the radius of a target, summed over some time."""

    frames: int = 0  # with a known position of the target
    returns: int = 0
    bodies: int = 0  # returns taken for people and vehicles
    detections: int = 0
    unsearched: int = 0  # of these detections
    unbounded: int = 0  # of these detections: amid strays that form groups of any size
    log_clutter: float = 0.0  # sum over the others
    unsupported: int = 0  # of these detections
    rows: int = 0  # row times with a known position of the target
    rows_near: int = 0
    error_m: float = 0.0  # sum over rows_near
    least_range_m: float = np.inf  # from the nearest LiDAR
    most_range_m: float = -np.inf
    least_error_m: float = np.inf  # of all rows
    path: PathThere | None = None  # the best

    def take(self, path: PathThere | None) -> None:
        """Keeps the higher ranked of `path` and the best so far; the most detections of both."""
        best = self.path
        if path is None or (best is not None and path.rank < best.rank):
            path, best = best, path
        if path is not None and best is not None and path.rejection == best.rejection:
            path = replace(path, detections=max(path.detections, best.detections))
        self.path = path

    def add(self, other: "Evidence") -> None:
        """Adds the evidence of another time."""
        for field in fields(Evidence):
            own, others = getattr(self, field.name), getattr(other, field.name)
            if field.name == "path":
                self.take(others)
            elif field.name.startswith("least_"):
                setattr(self, field.name, min(own, others))
            elif field.name.startswith("most_"):
                setattr(self, field.name, max(own, others))
            else:
                setattr(self, field.name, own + others)


@dataclass(frozen=True)
class SensorFrames:
    """The files of a sensor by stamps on the common clock, with pose and unit."""

    files: dict[int, Path]
    mounting: Mounting
    least_range_m: float = 0.0
    most_range_m: float = np.inf

    def returns_m(self, frame: TracedFrame) -> np.ndarray:
        """(N, 3) the returns of a frame in the common frame; InputError if its file is gone."""
        path = self.files.get(frame.stamp)
        if path is None:
            stamp = format_stamp_ns(frame.stamp)
            raise InputError(f"{frame.sensor}: no frame has the stamp {stamp} that the trace names")
        xyz_m, range_m = self.mounting.returns_m(path, frame.stamp - self.mounting.offset_ns)
        return xyz_m[(range_m >= self.least_range_m) & (range_m <= self.most_range_m)]


def _there(path: TracedPath, detections: int, rejection: str | None) -> PathThere:
    return PathThere(
        detections, path.log_likelihood_ratio, path.crowding_penalty, path.threshold, rejection
    )


class Collector:
    """Collects the evidence of each target by the begin of the second, in ns.

    Seconds are whole ones of the stamps, or the single one about the instant `at_ns`.
    """

    def __init__(
        self,
        targets: Sequence[Target],
        sensors: dict[str, SensorFrames],
        reach: Reach,
        at_ns: int | None = None,
    ):
        self.found: list[dict[int, Evidence]] = [{} for _ in targets]
        self._targets = targets
        self._sensors = sensors
        self._reach = reach
        self._at_ns = at_ns
        self._tracks = StreamTracks()

    def add_trace(self, lines: Iterable[TracedFrame | TracedPath | TracedTrack]) -> None:
        for line in lines:
            if isinstance(line, TracedFrame):
                self.add_frame(line)
            elif isinstance(line, TracedTrack):
                self.add_track(line)
            else:
                self.add_path(line)
        self.finish_trace()

    def add_frame(self, frame: TracedFrame) -> None:
        """Counts returns (from the file) and detections near each target at the frame's middle."""
        self._give_new()
        returns_m = None
        for own, where in self._near(np.array([frame.middle])):
            evidence = own.setdefault(int(where.begin_ns[0]), Evidence())
            if returns_m is None:
                returns_m = self._returns_m(frame)
            range_m = float(self._reach.ranges_m(where.places_m, np.array([frame.middle]))[0])
            evidence.frames += 1
            evidence.least_range_m = min(evidence.least_range_m, range_m)
            evidence.most_range_m = max(evidence.most_range_m, range_m)
            evidence.returns += int(where.is_near(returns_m).sum())
            evidence.bodies += int(where.is_near(np.array(frame.bodies).reshape(-1, 3)).sum())
            at_m = np.array([(d.x, d.y, d.z) for d in frame.detections]).reshape(-1, 3)
            for index in np.flatnonzero(where.is_near(at_m)):
                evidence.detections += 1
                evidence.unsearched += frame.rejection is not None
                log_clutter = frame.detections[index].log_clutter
                evidence.unbounded += log_clutter is None
                evidence.log_clutter += log_clutter or 0.0
                evidence.unsupported += frame.detections[index].unsupported
                evidence.take(self._path_to(frame, frame.detections[index], evidence))

    def _returns_m(self, frame: TracedFrame) -> np.ndarray:
        sensor = self._sensors.get(frame.sensor)
        if sensor is None:
            raise InputError(
                f"the trace has a frame of '{frame.sensor[:40]}', expected one of "
                f"{listed(self._sensors)}"
            )
        return sensor.returns_m(frame)

    def add_path(self, path: TracedPath) -> None:
        """Gives a path to each second in which it holds detections of a target."""
        if path.track is not None:
            self._tracks.begin(path)
            return
        for part, rejection in path.parts():
            self._give(path, part, rejection)

    def add_track(self, track: TracedTrack) -> None:
        """Notes a decision on a track of a stream."""
        confirmed = self._tracks.note(track)
        if confirmed is not None:
            self._give_begun(confirmed)

    def finish_trace(self) -> None:
        """To be called after the last line of a trace."""
        self._give_new()

    def _give_new(self) -> None:
        """Gives the paths that became tracks of a stream, after the first decision on these."""
        for path in self._tracks.take_new():
            self._give_begun(path)

    def _give_begun(self, path: TracedPath) -> None:
        for part, rejection in path.parts():
            is_cut = part.stop is not None
            self._give(path, part, rejection if is_cut else self._tracks.rejection_of(path.track))

    def _path_to(
        self, frame: TracedFrame, detection: TracedDetection, evidence: Evidence
    ) -> PathThere | None:
        """The path or track of a stream that has a detection, with those of the second so far."""
        path = self._tracks.path_of(detection.track)
        if path is not None:
            there = _there(path, 1, self._tracks.rejection_of(path.track))
        elif detection.rejection is not None:
            score = detection.log_likelihood_ratio or 0.0
            there = PathThere(1, score, 0.0, frame.threshold or 0.0, detection.rejection)
        else:
            return None
        if evidence.path is None or evidence.path.rejection != there.rejection:
            return there
        return replace(there, detections=min(evidence.path.detections + 1, evidence.detections))

    def _give(self, path: TracedPath, part: slice, rejection: str | None) -> None:
        detections = path.detections[part]
        time_ns = np.array([d[0] for d in detections], dtype=np.int64)
        at_m = np.array([d[1:] for d in detections], dtype=float).reshape(-1, 3)
        for own, where in self._near(time_ns):
            near = where.is_near(at_m[where.rows])
            begins_ns, counts = np.unique(where.begin_ns[near], return_counts=True)
            for begin_ns, count in zip(begins_ns, counts, strict=True):
                evidence = own.setdefault(int(begin_ns), Evidence())
                evidence.take(_there(path, int(count), rejection))

    def add_rows(self, tracks: Tracks) -> None:
        """Compares the rows of the trajectory with each target; of several tracks the nearest."""
        assert tracks.stamp_ns is not None
        for own, where in self._near(tracks.stamp_ns):
            error_m = np.linalg.norm(tracks.xyz_m[where.rows] - where.places_m, axis=1)
            # Sorted by time, then error: the first row of each time is the nearest track's.
            order = np.lexsort((error_m, tracks.stamp_ns[where.rows]))
            _, first = np.unique(tracks.stamp_ns[where.rows][order], return_index=True)
            for row in order[first]:
                evidence = own.setdefault(int(where.begin_ns[row]), Evidence())
                evidence.rows += 1
                evidence.least_error_m = min(evidence.least_error_m, float(error_m[row]))
                if error_m[row] <= where.radii_m[row]:
                    evidence.rows_near += 1
                    evidence.error_m += float(error_m[row])

    def add_unseen(self) -> None:
        """Adds empty evidence for seconds without a frame of any sensor."""
        begins_ns = [b for own in self.found for b, evidence in own.items() if evidence.frames]
        if not begins_ns:
            return
        for target, own in zip(self._targets, self.found, strict=True):
            time_ns = np.round(target.times_s * 1e9).astype(np.int64)
            for begin_ns in np.unique(self._begins_ns(time_ns)[self._are_asked(time_ns)]):
                if min(begins_ns) <= begin_ns <= max(begins_ns):
                    own.setdefault(int(begin_ns), Evidence())

    def _near(self, time_ns: np.ndarray) -> Iterator[tuple[dict[int, Evidence], "_Where"]]:
        """Positions of each target at the requested times at which it is known."""
        begins_ns, asked = self._begins_ns(time_ns), self._are_asked(time_ns)
        for target, own in zip(self._targets, self.found, strict=True):
            places_m = target.places_at(time_ns * 1e-9)
            rows = np.flatnonzero(asked & np.isfinite(places_m).all(axis=1))
            if len(rows):
                places_m = places_m[rows]
                radii_m = self._reach.radii_m(places_m, time_ns[rows])
                yield own, _Where(rows, begins_ns[rows], places_m, radii_m)

    def _begins_ns(self, time_ns: np.ndarray) -> np.ndarray:
        if self._at_ns is not None:
            return np.full(len(time_ns), self._at_ns - SECOND_NS // 2)
        return time_ns // SECOND_NS * SECOND_NS

    def _are_asked(self, time_ns: np.ndarray) -> np.ndarray:
        away_ns = time_ns - self._begins_ns(time_ns) - SECOND_NS // 2
        return np.abs(away_ns) <= SECOND_NS // 2


@dataclass(frozen=True)
class _Where:
    """Positions of a target at the times at which it is known."""

    rows: np.ndarray  # (K,) which of the times
    begin_ns: np.ndarray  # (K,) of their seconds
    places_m: np.ndarray  # (K, 3)
    radii_m: np.ndarray  # (K,)

    def is_near(self, points_m: np.ndarray) -> np.ndarray:
        """(N,) bool for points (N, 3), compared with the row's position or the only one."""
        return np.linalg.norm(points_m - self.places_m, axis=1) <= self.radii_m
