"""Exports are lossless: any trajectory, drawn at random, is written and read back."""

import json
import xml.etree.ElementTree as ET
from decimal import Decimal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from synthetic import TRAJ_HEADER
from unlidar.cli import main
from unlidar.truth import read_all_tracks, read_tracks

NS_PER_S = 10**9
LATEST_NS = 4 * 10**18  # within signed 64 bits
LATEST_ROS_NS = (2**31 - 1) * NS_PER_S  # a header has seconds in 32 bits
KML = {"gx": "http://www.google.com/kml/ext/2.2"}
METRES = st.floats(-1e5, 1e5, allow_nan=False)
ORIGIN = ["--origin", "1.3483,103.6831,40"]
IN_ONE_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@st.composite
def trajectories(draw, latest_ns: int = LATEST_NS) -> list[list]:
    """Rows of a traj.csv: stamp in ns, track, position, velocity, sigma, support."""
    rows = []
    for track in draw(st.lists(st.integers(0, 10**6), max_size=3, unique=True)):
        stamps = draw(st.lists(st.integers(0, latest_ns), min_size=1, max_size=8, unique=True))
        for stamp_ns in stamps:
            numbers = draw(st.lists(METRES, min_size=6, max_size=6))
            sigmas = draw(st.lists(st.floats(0, 100), min_size=3, max_size=3))
            rows.append([stamp_ns, track, *numbers, *sigmas, draw(st.integers(0, 10**6))])
    return rows


def write(folder: Path, rows: list[list]) -> Path:
    lines = [
        f"{Decimal(stamp_ns) / NS_PER_S:.9f},{track},{','.join(repr(v) for v in values)}"
        for stamp_ns, track, *values in rows
    ]
    path = folder / "traj.csv"
    path.write_text("\n".join([TRAJ_HEADER, *lines]) + "\n")
    return path


def export(trajectory: Path, name: str, *options: str) -> Path:
    out = trajectory.with_name(name)
    assert main(["export", str(trajectory), str(out), *options]) == 0
    return out


def by_track(rows: list[list]) -> dict[int, list[list]]:
    return {track: sorted(row for row in rows if row[1] == track) for track in {r[1] for r in rows}}


def as_rows(tracks) -> list[tuple]:
    columns = (tracks.stamp_ns.tolist(), *tracks.xyz_m.T.tolist())
    return sorted(zip(*columns, strict=True))


@IN_ONE_FOLDER
@given(trajectories())
def test_csv_gives_every_number_back(tmp_path, rows) -> None:
    trajectory = write(tmp_path, rows)
    back, was = (read_tracks(p) for p in (export(trajectory, "out.csv"), trajectory))
    assert as_rows(was) == sorted((r[0], *r[2:5]) for r in rows)
    assert every_column(back) == every_column(was)


def every_column(tracks) -> list[tuple]:
    columns = [tracks.stamp_ns, tracks.track_id, *tracks.xyz_m.T, *tracks.velocity_mps.T]
    columns += [*tracks.sigma_m.T, tracks.support]
    return sorted(zip(*(column.tolist() for column in columns), strict=True))


@IN_ONE_FOLDER
@given(trajectories())
def test_tum_gives_stamps_and_positions_back_a_file_each_track(tmp_path, rows) -> None:
    for old in tmp_path.glob("*.tum"):
        old.unlink()
    export(write(tmp_path, rows), "t.tum")
    files = sorted(tmp_path.glob("*.tum"))
    assert len(files) == max(1, len(by_track(rows)))
    assert as_rows(read_all_tracks(files)) == sorted((r[0], *r[2:5]) for r in rows)
    sizes = sorted(len(read_tracks(path)) for path in files)
    assert sizes == sorted(len(own) for own in by_track(rows).values()) or not rows


@IN_ONE_FOLDER
@given(trajectories())
def test_geojson_and_kml_hold_every_row_in_order_of_time(tmp_path, rows) -> None:
    trajectory = write(tmp_path, rows)
    found = json.loads(export(trajectory, "t.geojson", *ORIGIN).read_text())["features"]
    whens = [
        [when.text for when in track.iter() if when.tag.endswith("when")]
        for track in ET.parse(export(trajectory, "t.kml", *ORIGIN)).iter(f"{{{KML['gx']}}}Track")
    ]
    expected = [len(own) for _, own in sorted(by_track(rows).items())]
    assert [len(times) for times in whens] == expected
    assert [len(one["properties"]["times"]) for one in found] == expected
    for times in [*whens, *(one["properties"]["times"] for one in found)]:
        assert times == sorted(times)


@pytest.mark.parametrize("name", ["t.bag", "t.mcap"])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=15)
@given(rows=trajectories(LATEST_ROS_NS))
def test_recordings_hold_a_message_for_each_row_with_its_stamp_and_place(
    tmp_path, name, rows
) -> None:
    from rosbags.highlevel import AnyReader

    for old in tmp_path.glob("t.*"):
        old.unlink()
    out = export(write(tmp_path, rows), name)
    if not rows:
        return
    found = []
    with AnyReader([out]) as reader:
        for connection, _, content in reader.messages():
            if connection.topic.endswith("/odometry"):
                message = reader.deserialize(content, connection.msgtype)
                stamp, at = message.header.stamp, message.pose.pose.position
                found.append((stamp.sec * NS_PER_S + stamp.nanosec, at.x, at.y, at.z))
    assert sorted(found) == sorted((r[0], *r[2:5]) for r in rows)
