"""Tracks of a stream, from its trace: the path that each began with, and its decision."""

from unlidar.explain.trace import TracedPath, TracedTrack


class StreamTracks:
    """The paths that became tracks, with the latest decision on each."""

    def __init__(self) -> None:
        self._paths: dict[int, TracedPath] = {}
        self._rejections: dict[int, str | None] = {}  # for which they wait or are rejected
        self._new: list[TracedPath] = []

    def begin(self, path: TracedPath) -> None:
        """Takes a path that became a track."""
        assert path.track is not None
        self._paths[path.track] = path
        self._new.append(path)

    def take_new(self) -> list[TracedPath]:
        """The paths since the last call."""
        new, self._new = self._new, []
        return new

    def note(self, track: TracedTrack) -> TracedPath | None:
        """Takes a decision; the path of the track if it is confirmed, and so no longer rejected."""
        if track.state == "deleted":
            self._paths.pop(track.track, None)
            self._rejections.pop(track.track, None)
            return None
        self._rejections[track.track] = track.rejection
        return self._paths.get(track.track) if track.state == "confirmed" else None

    def path_of(self, track: int | None) -> TracedPath | None:
        """The path that a track began with."""
        return None if track is None else self._paths.get(track)

    def rejection_of(self, track: int | None) -> str | None:
        """The rule for which a track has no rows now."""
        return None if track is None else self._rejections.get(track)
