"""The engine in this process: its rows are those of the program, byte for byte."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import unlidar
from live_program import feed, message
from synthetic import TRAJ_HEADER, make_flight, seconds, track, write_pcd
from unlidar.events.event import decode

Frames = list[unlidar.Frame]

CONFIG = """
sensors:
  left:
    translation_m: [0.5, -0.25, 1.0]
    rotation: [0, 0, 0.6, 0.8]
  right:
    time_offset_s: -0.04
"""
TRANSLATION_M = np.array([0.5, -0.25, 1.0])
ROTATION = np.array([[0.28, -0.96, 0], [0.96, 0.28, 0], [0, 0, 1]])
ENDLESS = {"live.delay_s": float("inf"), "live.window_s": float("inf")}


@pytest.fixture(scope="module", autouse=True)
def _built() -> None:
    pytest.importorskip("unlidar._engine", reason="the engine for Python is not built")


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("config") / "station.yaml"
    path.write_text(CONFIG)
    return path


@pytest.fixture(scope="module")
def frames() -> Frames:
    """Of two sensors, one with point times; empty ones, and rays that returned nothing."""
    flight = make_flight()
    rng = np.random.default_rng(3)
    found = []
    for i, stamp_ns in enumerate(flight.stamps_ns):
        cloud, times_s = flight.clouds[i], flight.times_s[i]
        left = (cloud[::2] - TRANSLATION_M) @ ROTATION
        left[rng.integers(0, len(left), 9)] = 0
        left[rng.integers(0, len(left), 3)] = [np.nan, np.inf, 1]
        some = slice(0, 0 if i % 20 == 7 else None)
        offsets_ns = np.rint(times_s[::2].astype(float) * 1e9).astype(np.int64)
        found.append(unlidar.Frame("left", stamp_ns, left[some].astype("f4"), offsets_ns[some]))
        some = slice(0, 0 if i == 13 else None)
        found.append(unlidar.Frame("right", stamp_ns + 40_000_000, cloud[1::2][some]))
    return found


def unaligned(frame: unlidar.Frame) -> unlidar.Frame:
    """Fields of packed records, as drivers have them."""
    records = np.zeros(len(frame.xyz), [("tag", "u1"), ("xyz", "f4", 3), ("t", "i8")])
    records["xyz"] = frame.xyz
    if frame.offsets_ns is None:
        return frame._replace(xyz=records["xyz"])
    records["t"] = frame.offsets_ns
    return frame._replace(xyz=records["xyz"], offsets_ns=records["t"])


def backwards(frame: unlidar.Frame) -> unlidar.Frame:
    """The same rows through negative strides, columns first."""
    xyz = np.asfortranarray(frame.xyz[::-1, ::-1])[::-1, ::-1]
    offsets = None if frame.offsets_ns is None else frame.offsets_ns[::-1].copy()[::-1]
    return frame._replace(xyz=xyz, offsets_ns=offsets)


def read_only(frame: unlidar.Frame) -> unlidar.Frame:
    frame.xyz.flags.writeable = False
    return frame


VIEWS = {
    "float32": lambda frame: frame,
    "float64": lambda frame: frame._replace(xyz=frame.xyz.astype(np.float64)),
    "strided": lambda frame: frame._replace(xyz=np.repeat(frame.xyz, 2, axis=1)[:, ::2]),
    "unaligned": unaligned,
    "backwards": backwards,
    "read only": read_only,
}


def pcd(frame: unlidar.Frame, path: Path) -> bytes:
    extra = {} if frame.offsets_ns is None else {"t": frame.offsets_ns}
    write_pcd(path, frame.xyz, **extra)
    return path.read_bytes()


def fed(frames: Frames, folder: Path, *options: str | Path) -> tuple[str, list[Any]]:
    """Trajectory and events of --stdin."""
    data = b"".join(
        message(f.sensor, seconds(f.stamp_ns), pcd(f, folder / "frame.pcd")) for f in frames
    )
    code, out, said = feed(data, folder / "traj.csv", "--events", "-", *options)
    assert code == 0, said
    trajectory = (folder / "traj.csv").read_text()
    (folder / "traj.csv").unlink()
    return trajectory, [decode(line)[0] for line in out.splitlines()]


def recorded(frames: Frames, folder: Path, *options: str | Path) -> str:
    """Trajectory of --frames."""
    for frame in frames:
        path = folder / frame.sensor / f"{seconds(frame.stamp_ns)}.pcd"
        path.parent.mkdir(exist_ok=True)
        pcd(frame, path)
    track([f"{n}={folder / n}" for n in ("left", "right")], folder / "traj.csv", *options)
    return (folder / "traj.csv").read_text()


def text_of(number: float) -> str:
    text = f"{number:.6f}"
    return text[1:] if float(text) == 0 and text[0] == "-" else text


def csv_of(rows: list[tuple[Any, ...]]) -> str:
    lines = [TRAJ_HEADER]
    for time_ns, number, *values, support in rows:
        lines.append(
            ",".join([seconds(time_ns), f"{number:.0f}", *map(text_of, values), f"{support:.0f}"])
        )
    return "\n".join(lines) + "\n"


def csv_of_events(events: list[unlidar.Event]) -> str:
    columns = ("timestamp", "track", *TRAJ_HEADER.split(",")[2:])
    return csv_of(
        [tuple(getattr(e, c) for c in columns) for e in events if isinstance(e, unlidar.Row)]
    )


def csv_of_tracks(tracks: list[unlidar.Track]) -> str:
    rows = [row.item() for one in tracks for row in one.rows]
    return csv_of(sorted(rows, key=lambda row: row[:2]))


def streamed(engine: unlidar.Engine, frames: Frames) -> list[unlidar.Event]:
    events = [event for frame in frames for event in engine.add(*frame)]
    return events + engine.close()


# --- the law ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plain(frames: Frames, config: Path, tmp_path_factory: pytest.TempPathFactory):
    return fed(frames, tmp_path_factory.mktemp("plain"), "--config", config)


@pytest.mark.parametrize("view", VIEWS)
def test_rows_of_an_engine_are_those_of_stdin(view: str, frames, config, plain) -> None:
    events = streamed(unlidar.Engine(config), [VIEWS[view](frame) for frame in frames])
    assert csv_of_events(events) == plain[0]
    assert plain[0].count("\n") > 40


def test_events_are_those_of_stdin(frames, config, plain) -> None:
    events = streamed(unlidar.Engine(config), frames)
    assert {type(event).__name__ for event in events} == {
        *("TrackBegins", "Row", "Now", "TrackEnds", "SensorState", "EngineState")
    }
    for event, expected in zip(events, plain[1], strict=True):
        assert type(event) is type(expected)
        for key, value in vars(expected).items():
            exact = not isinstance(value, float)
            assert getattr(event, key) == (value if exact else pytest.approx(value, abs=1e-6)), key


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        ((), {}),
        (("--rate", "7.5"), {"rate_hz": 7.5}),
        (("--set", "live.delay_s=0.5"), {"settings": {"live.delay_s": 0.5}}),
        (("--set", "live.delay_s=.inf", "--set", "live.window_s=.inf"), {"settings": ENDLESS}),
    ],
)
def test_options_are_those_of_the_program(options, arguments, frames, tmp_path) -> None:
    trajectory, _ = fed(frames, tmp_path, *options)
    assert csv_of_events(streamed(unlidar.Engine(**arguments), frames)) == trajectory
    assert trajectory.count("\n") > 30


@pytest.mark.parametrize("view", VIEWS)
def test_tracks_are_those_of_a_recording(view: str, frames, config, tmp_path) -> None:
    expected = recorded(frames, tmp_path, "--config", config, "--rate", "20")
    tracks = unlidar.track(map(VIEWS[view], frames), config, rate_hz=20)
    assert csv_of_tracks(tracks) == expected
    assert len(tracks) == 1
    assert tracks[0].rows.dtype.names == ("timestamp_ns", *TRAJ_HEADER.split(",")[1:])
    kinds = [tracks[0].rows.dtype[name] for name in tracks[0].rows.dtype.names]
    assert kinds == [np.int64, *[np.float64] * 11]
    assert sum(vars(tracks[0].kind).values()) == pytest.approx(1)


def test_the_papers_method_gives_what_the_program_gives_with_pcl(frames, tmp_path) -> None:
    """Its engine is linked to the program alone; both find the same clusters."""
    options = ("--set", "method=paper", "--set", "paper.global_clusters.engine=pcl")
    expected = recorded(frames, tmp_path, *options)
    assert csv_of_tracks(unlidar.track(frames, settings={"method": "paper"})) == expected
    assert expected.count("\n") > 5


def test_frames_of_a_recording_may_be_tuples_in_any_order(frames, config, tmp_path) -> None:
    expected = recorded(frames, tmp_path, "--config", config)
    mixed = [frames[0], *reversed(frames[1:])]
    short = [tuple(f)[: 3 if f.offsets_ns is None else 4] for f in mixed]
    assert csv_of_tracks(unlidar.track(iter(short), str(config))) == expected


def test_arrays_are_copied(frames, config, plain) -> None:
    engine, events = unlidar.Engine(config), []
    for frame in frames:
        xyz = frame.xyz.copy()
        events += engine.add(frame.sensor, frame.stamp_ns, xyz, frame.offsets_ns)
        xyz[:] = 7.0
    assert csv_of_events(events + engine.close()) == plain[0]


def test_time_advances_without_frames(frames) -> None:
    engine = unlidar.Engine()
    for frame in frames:
        engine.add(*frame)
    told = engine.advance(frames[-1].stamp_ns + 5_000_000_000)
    silent = [event.name for event in told if isinstance(event, unlidar.SensorState)]
    assert silent == ["left", "right"]


# --- what a user does wrong -------------------------------------------------------------------

XYZ = np.ones((4, 3), np.float32)
NS = 1_706_300_000_000_000_000


@pytest.mark.parametrize(
    ("frame", "kind", "said"),
    [
        (("a", NS, XYZ[:, :2]), unlidar.InputError, r"shape \(4, 2\) and dtype float32, expected"),
        (("a", NS, XYZ[0]), unlidar.InputError, r"shape \(3,\) and dtype float32, expected .*n, 3"),
        (("a", NS, XYZ.astype(int)), unlidar.InputError, r"\(4, 3\) and dtype int64, .* float32"),
        (("a", NS, XYZ.astype(">f4")), unlidar.InputError, "dtype >f4, expected"),
        (("a", NS, XYZ.astype("f2")), unlidar.InputError, "dtype float16, expected"),
        (("a", NS, XYZ.astype("M8[ns]")), unlidar.InputError, "datetime64.*, expected"),
        (
            ("a", NS, XYZ.tolist()),
            unlidar.InputError,
            "stamp 1706300000000000000 ns: xyz is a li",
        ),
        (("a", NS, None), unlidar.InputError, "xyz is a NoneType"),
        (
            ("a", NS, np.ma.masked_invalid(XYZ)),
            unlidar.InputError,
            r"xyz is a masked array of shape \(4, 3\), expected one without",
        ),
        (
            ("a", NS, XYZ, np.zeros(3, "i8")),
            unlidar.InputError,
            r"\(3,\) and dtype int64, .*\(4,\)",
        ),
        (
            ("a", NS, XYZ, np.zeros(0, "i8")),
            unlidar.InputError,
            r"\(0,\) and dtype int64, .*\(4,\)",
        ),
        (("a", NS, XYZ, np.zeros(4)), unlidar.InputError, "dtype float64, expected .* int64"),
        (
            ("a", NS, np.full((4, 3), -1e39)),
            unlidar.InputError,
            r"xyz has -1e\+39, expected metres",
        ),
        (("a", NS, XYZ, np.ma.zeros(4, int)), unlidar.InputError, "offsets_ns is a masked array"),
        (("a", NS, XYZ, np.full(4, 10**11)), unlidar.InputError, "time 100000000000"),
        (("a", NS + 0.5, XYZ), unlidar.InputError, "stamp_ns: a float, expected"),
        (("a", True, XYZ), unlidar.InputError, "stamp_ns: a bool, expected"),
        (("a", 2**64, XYZ), unlidar.InputError, "stamp_ns: 18446744073709551616, expected"),
        (("a", 2**62, XYZ), unlidar.InputError, "frame of a, stamp 4611686018427387904 ns: "),
        (("a b", NS, XYZ), unlidar.UsageError, "sensor: 'a b', expected a name"),
        (("a\ud800", NS, XYZ), unlidar.UsageError, r"sensor: 'a\?', expected a name"),
        ((7, NS, XYZ), unlidar.UsageError, "sensor: a int, expected a name"),
    ],
)
def test_errors_name_value_and_expectation(frame, kind, said) -> None:
    with pytest.raises(kind, match=said) as refused:
        engine = unlidar.Engine()
        engine.add(*frame)
        engine.close()
    assert "\n" not in str(refused.value)
    with pytest.raises(kind, match=said):
        unlidar.track([frame])


@pytest.mark.parametrize(
    ("arguments", "kind", "said"),
    [
        ({"config": "absent.yaml"}, unlidar.ConfigError, "absent.yaml"),
        ({"config": ""}, unlidar.ConfigError, "config: '', expected the path"),
        ({"config": "a\0b"}, unlidar.ConfigError, "config: .*, expected the path"),
        ({"config": 5}, unlidar.ConfigError, "config: 5, expected the path"),
        ({"config": "\udcff.yaml"}, unlidar.ConfigError, "config: .*, expected the path"),
        ({"poses": "\udcff.tum"}, unlidar.UsageError, "poses: .*, expected a TUM file"),
        ({"poses": {"a": "b\0.tum"}}, unlidar.UsageError, "poses: .*, expected a TUM file"),
        ({"settings": {"live.delay_s": "1\0"}}, unlidar.UsageError, "expected a text in UTF-8"),
        ({"settings": {"live.\udcff": 1}}, unlidar.UsageError, "expected a text in UTF-8"),
        ({"settings": "live.delay_s=1"}, unlidar.UsageError, "settings: 'live.* expected keys"),
        ({"settings": {"live.delay": 1}}, unlidar.ConfigError, "live.delay"),
        (
            {"settings": {"paper.local_clusters.engine": "pcl"}},
            unlidar.ConfigError,
            "'pcl', expected",
        ),
        ({"settings": {"live.delay_s": -1}}, unlidar.ConfigError, "live.delay_s"),
        ({"settings": {"live.delay_s": object()}}, unlidar.UsageError, "live.delay_s is of type"),
        ({"rate_hz": 0}, unlidar.UsageError, "rate_hz: 0, expected"),
        ({"rate_hz": float("nan")}, unlidar.UsageError, "rate_hz: nan, expected"),
        ({"rate_hz": 2e6}, unlidar.UsageError, "rate_hz: 2000000.0, expected"),
        ({"rate_hz": "10"}, unlidar.UsageError, "rate_hz: '10', expected"),
        ({"rate_hz": True}, unlidar.UsageError, "rate_hz: True, expected"),
    ],
)
def test_errors_of_the_configuration(arguments, kind, said) -> None:
    with pytest.raises(kind, match=said):
        unlidar.Engine(**arguments)
    with pytest.raises(kind, match=said):
        unlidar.track([], **arguments)


def test_a_refused_frame_changes_nothing(frames, config, plain) -> None:
    engine, events = unlidar.Engine(config), []
    for frame in frames:
        events += engine.add(*frame)
        with pytest.raises(unlidar.InputError, match="of an earlier frame"):
            engine.add(*frame)
        with pytest.raises(unlidar.InputError, match="shape"):
            engine.add(frame.sensor, frame.stamp_ns + 1, frame.xyz.T[:2])
    assert csv_of_events(events + engine.close()) == plain[0]


def test_bad_frames_are_skipped_where_that_is_set(frames, config, caplog) -> None:
    twice = [frame for frame in frames for _ in range(2)]
    settings = {"input.skip_bad_frames": True}
    once = csv_of_tracks(unlidar.track(frames, config))
    assert csv_of_tracks(unlidar.track(twice, config, settings)) == once
    assert any("bad and skipped" in record.message for record in caplog.records)


def test_frames_that_are_left_out_are_noted(caplog) -> None:
    engine = unlidar.Engine()
    for i in range(20):
        engine.add("a", NS + i * 100_000_000, XYZ)
    assert caplog.messages == []
    for i in range(5):  # decreasing
        engine.add("a", NS - i * 100_000_000 - 1, XYZ)
    late = "later than live.reorder_s and dropped, the last: frame of a, stamp"
    assert [told.partition(" ")[0] for told in caplog.messages] == ["1", "2", "4"]
    assert all(late in told for told in caplog.messages)
    caplog.clear()
    engine.add("a", NS + 3_600_000_000_000, XYZ)
    (state,) = engine.close()
    assert (state.frames, state.dropped) == (20, 6)
    assert ["astray and left out" in told for told in caplog.messages] == [True]


def test_values_of_numpy_are_settings() -> None:
    unlidar.Engine(settings={"live.delay_s": np.float32(0.5), "live.window_s": np.int64(30)})
    unlidar.Engine(settings={"sensors.a.translation_m": np.zeros(3)})
    with pytest.raises(unlidar.ConfigError, match=r"sensors\.a\.translation_m"):
        unlidar.Engine(settings={"sensors.a.translation_m": np.zeros(2)})


@pytest.mark.parametrize(("period_ns", "is_noted"), [(100_000, True), (2_000_000, False)])
def test_stamps_that_can_be_no_nanoseconds_are_noted(period_ns, is_noted, caplog) -> None:
    unlidar.track(("a", NS + i * period_ns, XYZ) for i in range(20))
    assert [("likely microseconds" in told) for told in caplog.messages] == [True] * is_noted


def test_a_sensor_without_a_pose_is_noted(config, caplog) -> None:
    unlidar.Engine(config).add("roof", NS, XYZ)
    assert caplog.messages == ["the config has no sensors.roof, it stands at the origin"]


def test_coordinates_that_are_no_metres_are_refused_as_of_a_recording() -> None:
    random = np.random.default_rng(1)
    frames = [
        (sensor, NS + i * 100_000_000, random.uniform(-30_000, 30_000, (returns, 3)))
        for i in range(20)
        for sensor, returns in (("ground", 500), ("sky", 3))  # which has too few to tell
    ]
    with pytest.raises(unlidar.InputError, match=r"ground: .* likely millimetres"):
        unlidar.track(frames)


def test_items_that_are_no_frames_are_refused() -> None:
    for frames in (None, 5):
        with pytest.raises(unlidar.UsageError, match=f"frames: {frames}, expected an iterable"):
            unlidar.track(frames)
    with pytest.raises(unlidar.UsageError, match="item 2 is a tuple of 2, expected a Frame"):
        unlidar.track([("a", NS, XYZ), ("a", NS)])
    with pytest.raises(unlidar.UsageError, match="item 1 is a ndarray, expected a Frame"):
        unlidar.track([XYZ])
