"""`unlidar export --to LOG.courageous.json`: the log of CEN CWA 18150."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from flights import join_tracks, track_at, truth_at, write_result
from pyproj import Transformer
from unlidar.cli import main
from unlidar.errors import InputError
from unlidar.geodesy import Origin, from_geodetic, to_geodetic
from unlidar.geoid import GRID_NAME, find_geoid_grid, geoid_height_m

TIMES = np.arange(0, 6, 0.1)
PLACE = (51.156888, 2.738243, 56.9)
KINDS = {0: {"drone": 0.2, "bird_like": 0.6, "unknown": 0.2}, 4: {"drone": 0.9, "bird_like": 0.02}}


@pytest.fixture
def result(tmp_path: Path) -> Path:
    """Two tracks at the same time, and what they may be."""
    tracks = join_tracks(track_at(TIMES[:20]), track_at(TIMES, [12.0, -3, 2], 4.0))
    folder = write_result(tmp_path / "flight", truth_at(TIMES), tracks)
    told = [{"track_id": track, "kind": kind} for track, kind in KINDS.items()]
    (folder / "summary.json").write_text(json.dumps({"tracks": told}))
    return folder


@pytest.fixture
def grid() -> Path:
    found = find_geoid_grid()
    if found is None:
        pytest.skip(f"PROJ's {GRID_NAME} is not installed")
    return found


def log_of(source: Path, *options: str) -> dict:
    out = source.parent / "log.courageous.json"
    place = ",".join(map(str, PLACE))
    assert main(["export", str(source), "--origin", place, "--to", str(out), *options]) == 0
    return json.loads(out.read_text())


def rows_of(result: Path) -> list[dict[str, str]]:
    with (result / "traj.csv").open() as file:
        return sorted(csv.DictReader(file), key=lambda row: int(row["track_id"]))


def test_the_log_is_valid_by_the_schema(result, shared):
    schema = json.loads((shared / "data/courageous/courageous.schema.json").read_text())
    jsonschema.validate(log_of(result), schema)
    jsonschema.validate(log_of(result / "traj.csv"), schema)
    (result / "traj.csv").write_text("timestamp,x,y,z\n")
    jsonschema.validate(log_of(result / "traj.csv"), schema)


@pytest.mark.parametrize("heading", [90, 0, 225])
def test_places_times_and_velocities_are_those_of_the_rows(result, heading):
    log = log_of(result, "--geoid", "45.5", "--heading", str(heading))
    records = [record for track in log["tracks"] for record in track["records"]]
    rows = rows_of(result)
    assert [track["uas_id"] for track in log["tracks"]] == [0, 4]
    assert [record["record_number"] for record in records] == list(range(len(rows)))
    place = [[r["location"][key] for key in ("lat", "lon", "height_amsl")] for r in records]
    station = Origin(*PLACE, float(heading))
    found = from_geodetic(station, np.array(place) + np.array([0, 0, 45.5]))
    expected = np.array([[float(row[axis]) for axis in "xyz"] for row in rows])
    assert found == pytest.approx(expected, abs=2e-5)
    for record, row in zip(records, rows, strict=True):
        assert record["time"] == round(float(row["timestamp"]) * 1e3)
    # A second at a velocity leads from one place to the other.
    velocity = [float(rows[0][f"v{axis}"]) for axis in "xyz"]
    east_north_up = Origin(*PLACE)
    ends = to_geodetic(station, np.stack([expected[0], expected[0] + velocity]))
    begin, end = from_geodetic(east_north_up, ends)
    told = [records[0]["velocity"][key] for key in ("east", "north", "up")]
    assert told == pytest.approx(end - begin, abs=1e-9)


def test_what_a_track_may_be_is_its_class_and_the_certainty_of_its_alarm(result):
    bird, drone = log_of(result)["tracks"]
    assert {r["classification"] for r in bird["records"]} == {"Other"}
    assert {r["classification"] for r in drone["records"]} == {"UAV"}
    assert drone["records"][0]["alarm"] == {"active": True, "certainty": 0.9}
    (unknown, _) = log_of(result / "traj.csv")["tracks"]
    assert {r["classification"] for r in unknown["records"]} == {"Unknown"}
    assert unknown["records"][0]["alarm"] == {"active": True, "certainty": 1.0}


def test_the_geoid_is_that_of_proj(grid):
    proj = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        f"+step +inv +proj=vgridshift +grids={grid} +multiplier=1"
    )
    rng = np.random.default_rng(1)
    places = [(51.156888, 2.738243), (0, 179.99), (0, -180), (0, 180), (90, 0), (-90, 7)]
    places += zip(rng.uniform(-90, 90, 50), rng.uniform(-180, 180, 50), strict=True)
    for lat, lon in places:
        assert geoid_height_m(grid, lat, lon) == pytest.approx(
            -proj.transform(lon, lat, 0.0)[2], abs=1e-4
        )


def test_heights_are_above_the_sea_where_the_geoid_is_known(result, grid):
    log = log_of(result)
    height_m = log["static_cuas_location"]["height_amsl"]
    assert height_m == pytest.approx(PLACE[2] - geoid_height_m(grid, *PLACE[:2]), abs=1e-5)


def test_heights_above_the_ellipsoid_are_said(result, monkeypatch, capsys):
    monkeypatch.setattr("unlidar.export.courageous.find_geoid_grid", lambda: None)
    assert log_of(result)["static_cuas_location"]["height_amsl"] == PLACE[2]
    assert "height_amsl is above the ellipsoid" in capsys.readouterr().err


def test_what_is_no_geoid_is_refused(tmp_path):
    for content in (b"", b"x" * 40, b"\0" * 100):
        (tmp_path / GRID_NAME).write_bytes(content)
        with pytest.raises(InputError, match="cannot be read as a geoid"):
            geoid_height_m(tmp_path / GRID_NAME, 1.0, 2.0)


def test_what_does_not_fit_together_is_refused(result, tmp_path, fails):
    out = tmp_path / "a.courageous.json"
    assert "--origin" in fails(2, "export", result, "--to", out)
    assert "--geoid" in fails(2, "export", result, tmp_path / "a.tum", "--geoid", "4")
    far = fails(2, "export", result, "--to", out, "--origin", "1,2,3", "--geoid", "1e3")
    assert "--geoid 1000: expected metres from -110 to 110" in far
    assert "OUT" in fails(2, "export", out)
    (result / "summary.json").write_text('{"tracks": [{"track_id": 0, "kind": {}}]}')
    assert "summary.json: tracks" in fails(4, "export", result, out, "--origin", "1,2,3")
    assert not out.exists()
