"""`unlidar export`: what is read back are the numbers of the trajectory."""

import csv
import json
import zipfile
from datetime import datetime
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from evo.tools import file_interface
from flights import join_tracks, track_at, truth_at, write_result
from pyproj import Transformer
from unlidar.cli import main
from unlidar.completion import complete
from unlidar.evaluation import evaluate_files
from unlidar.geodesy import Origin, from_geodetic, to_geodetic
from unlidar.truth import read_tracks

TIMES = np.arange(0, 6, 0.1)
ORIGIN = "1.348300,103.683100,40.5"
STATION = Origin(1.3483, 103.6831, 40.5)


@pytest.fixture
def result(tmp_path) -> Path:
    """Two tracks of different length, the second the longer."""
    tracks = join_tracks(track_at(TIMES[:20]), track_at(TIMES, [12.0, -3, 2], 4.0))
    return write_result(tmp_path / "flight", truth_at(TIMES), tracks)


def rows_of(result: Path) -> dict[str, list[dict[str, str]]]:
    """Rows of traj.csv as written, by track."""
    tracks: dict[str, list[dict[str, str]]] = {}
    with (result / "traj.csv").open() as file:
        for row in csv.DictReader(file):
            tracks.setdefault(row["track_id"], []).append(row)
    return tracks


def positions(rows: list[dict[str, str]]) -> np.ndarray:
    return np.array([[float(row[axis]) for axis in "xyz"] for row in rows])


def write(result: Path, name: str, *options: str) -> Path:
    out = result.parent / name
    assert main(["export", str(result), str(out), *options]) == 0
    return out


def test_tum_is_a_file_for_each_track_and_keeps_every_digit(result, capsys):
    out = write(result, "out.tum")
    other = out.with_name("out_track0.tum")
    assert capsys.readouterr().out.split() == [str(other), str(out)]
    for path, track in ((out, "4"), (other, "0")):
        lines = [line.split() for line in path.read_text().splitlines()[1:]]
        rows = rows_of(result)[track]
        assert [line[0] for line in lines] == [row["timestamp"] for row in rows]
        assert [[float(v) for v in line[1:4]] for line in lines] == positions(rows).tolist()
        assert {tuple(line[4:]) for line in lines} == {("0", "0", "0", "1")}
        theirs = file_interface.read_tum_trajectory_file(str(path))
        assert theirs.positions_xyz.tolist() == positions(rows).tolist()


def test_csv_keeps_every_column_and_can_be_evaluated_and_exported_again(result):
    out = write(result, "out.csv", "--origin", ORIGIN)
    with out.open() as file:
        written = list(csv.DictReader(file))
    rows = [row for track in rows_of(result).values() for row in track]
    assert len(written) == len(rows)
    for ours, row in zip(written, rows, strict=True):
        assert ours["timestamp"] == row["timestamp"]
        assert all(float(ours[name]) == float(row[name]) for name in row)
        seconds = datetime.fromisoformat(ours["utc"]).timestamp()
        assert seconds == pytest.approx(float(row["timestamp"]), abs=2e-6)
    place = np.array([[float(r[k]) for k in ("latitude", "longitude", "height")] for r in written])
    assert from_geodetic(STATION, place) == pytest.approx(positions(rows), abs=2e-5)
    truth = result / "ground_truth.csv"
    assert evaluate_files(truth, out) == evaluate_files(truth, result / "traj.csv")
    again = result.parent / "again.csv"
    assert main(["export", str(out), str(again), "--origin", ORIGIN]) == 0
    assert again.read_bytes() == out.read_bytes()


def test_kml_has_a_track_with_times_for_each_track(result):
    root = ElementTree.parse(write(result, "out.kml", "--origin", ORIGIN)).getroot()
    spaces = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
    places = root.findall("k:Document/k:Placemark", spaces)
    assert [p.findtext("k:name", None, spaces) for p in places] == ["track 0", "track 4"]
    for place, rows in zip(places, rows_of(result).values(), strict=True):
        track = place.find("gx:Track", spaces)
        assert track.findtext("k:altitudeMode", None, spaces) == "absolute"
        whens = [e.text for e in track.findall("k:when", spaces)]
        assert [w[-11:-1] for w in whens] == ["." + r["timestamp"].split(".")[1] for r in rows]
        coords = [e.text.split() for e in track.findall("gx:coord", spaces)]
        lon, lat, height = np.array(coords, dtype=float).T
        found = from_geodetic(STATION, np.stack([lat, lon, height], axis=1))
        assert found == pytest.approx(positions(rows), abs=2e-5)


def test_names_that_xml_and_csv_have_signs_for_do_not_break_them(result, tmp_path):
    nasty = result.rename(tmp_path / 'a,"<b>\n\x1b[1m')
    root = ElementTree.parse(write(nasty, "out.kml", "--origin", ORIGIN)).getroot()
    name = root.findtext("{*}Document/{*}name")
    assert name == 'a,"<b>\\n\\x1b[1m'
    with write(nasty, "mmaud_results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["Sequence"] for row in rows} == {nasty.name}


def test_geojson_has_a_line_for_each_track_with_its_times_and_sigmas(result):
    content = json.loads(write(result, "out.geojson", "--origin", ORIGIN).read_text())
    assert content["type"] == "FeatureCollection"
    for feature, (track, rows) in zip(content["features"], rows_of(result).items(), strict=True):
        assert feature["geometry"]["type"] == "LineString"
        assert feature["properties"]["track_id"] == int(track)
        assert len(feature["properties"]["times"]) == len(rows)
        assert feature["properties"]["sigma_m"] == [[0.1, 0.1, 0.1]] * len(rows)
        assert feature["properties"]["support"] == [float(r["support"]) for r in rows]
        lon, lat, height = np.array(feature["geometry"]["coordinates"]).T
        found = from_geodetic(STATION, np.stack([lat, lon, height], axis=1))
        assert found == pytest.approx(positions(rows), abs=2e-5)


@pytest.mark.parametrize("name", ["a.csv", "a.kml", "a.geojson", "a.tum", "a.mcap"])
@pytest.mark.parametrize("begin_s", [12, 1_700_000_000])
def test_dates_of_stamps_that_are_no_unix_time_are_told_of(name, begin_s, tmp_path, capsys):
    file = tmp_path / "traj.csv"
    file.write_text(f"timestamp,x,y,z\n{begin_s}.5,1,2,3\n{begin_s + 1},1,2,3\n")
    assert main(["export", str(file), str(tmp_path / name), "--origin", ORIGIN]) == 0
    said = f"{file}: stamp 12.500000000 is no Unix time, as of 1970: dates in {name}"
    is_told = begin_s == 12 and name not in ("a.tum", "a.mcap")
    assert (said in capsys.readouterr().err) == is_told


def test_what_is_read_is_not_replaced_by_what_is_written(tmp_path, fails):
    (tmp_path / "traj.csv").write_text(text := "timestamp,x,y,z\n1,1,2,3\n")
    (tmp_path / "link.csv").symlink_to("traj.csv")
    for source in (tmp_path, tmp_path / "traj.csv", tmp_path / "link.csv"):
        for form in ("csv", "tum"):
            said = fails(2, "export", source, tmp_path / "traj.csv", "--format", form)
            assert "traj.csv: is what is read, expected another name" in said
    assert (tmp_path / "traj.csv").read_text() == text


def test_a_heading_without_an_origin_is_refused(tmp_path, fails):
    (tmp_path / "traj.csv").write_text("timestamp,x,y,z\n1,1,2,3\n")
    said = fails(2, "export", tmp_path, tmp_path / "a.csv", "--heading", "30")
    assert "--heading needs --origin" in said
    assert not (tmp_path / "a.csv").exists()


def test_places_are_those_of_proj():
    rng = np.random.default_rng(1)
    for lat, lon in ((1.35, 103.7), (-33.9, 18.4), (0, -180), (78.2, 15.6), (-89.99, 0), (90, 0)):
        xyz = rng.uniform(-3000, 3000, (50, 3))
        height = rng.uniform(-400, 9000)
        proj = Transformer.from_pipeline(
            f"+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lat_0={lat} +lon_0={lon} "
            f"+h_0={height} +step +inv +proj=cart +ellps=WGS84"
        )
        ours = to_geodetic(Origin(lat, lon, height), xyz)
        lon_deg, lat_deg, height_m = proj.transform(*xyz.T)
        assert ours[:, 0] == pytest.approx(lat_deg, abs=1e-9)
        turn = (ours[:, 1] - lon_deg + 180) % 360 - 180
        assert turn == pytest.approx(0, abs=1e-6 if abs(lat) > 89 else 1e-9)
        assert ours[:, 2] == pytest.approx(height_m, abs=1e-6)
        assert from_geodetic(Origin(lat, lon, height), ours) == pytest.approx(xyz, abs=1e-7)


@pytest.mark.parametrize(("heading", "north_east"), [(90, (0, 1)), (0, (1, 0)), (225, (-1, -1))])
def test_the_heading_is_the_compass_direction_of_x(heading, north_east):
    moved = to_geodetic(Origin(10, 20, 0, heading), np.array([[100.0, 0, 0]]))[0]
    signs = [0 if abs(v) < 1e-7 else np.sign(v) for v in (moved[0] - 10, moved[1] - 20)]
    assert tuple(signs) == north_east
    left = to_geodetic(Origin(10, 20, 0, heading), np.array([[0, 100.0, 0]]))[0]
    ahead = np.array([moved[1] - 20, moved[0] - 10])
    aside = np.array([left[1] - 20, left[0] - 10])
    assert ahead[0] * aside[1] - ahead[1] * aside[0] > 0  # y is to the left of x, z up


def mmaud_rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(text.splitlines()))


def test_the_challenge_gets_a_position_for_every_stamp_asked_for(result):
    asked = [f"{1_706_300_000 + t:.6f}" for t in (-1.0, 0.05, 1.234567, 9.0)]
    template = result.parent / "stamps.csv"
    template.write_text("Sequence,Timestamp\n" + "".join(f"flight,{t}\n" for t in asked))
    out = write(result, "mmaud_results.csv", "--at", str(template), "--uav-type", "2")
    text = out.read_text()
    assert text.splitlines()[0] == "Sequence,Timestamp,Position,Classification"
    rows = mmaud_rows(text)
    assert [row["Timestamp"] for row in rows] == asked
    assert {(row["Sequence"], row["Classification"]) for row in rows} == {("flight", "2")}
    found = np.array([json.loads("[" + row["Position"][1:-1] + "]") for row in rows])
    expected = complete(read_tracks(result / "traj.csv"), np.array(asked, dtype=float))
    assert found == pytest.approx(expected, abs=1e-6)
    assert not np.isnan(found).any()


def test_the_challenge_takes_several_sequences_in_one_archive(result):
    out = result.parent / "submission.zip"
    sources = [f"seq{i}={result}" for i in (1, 2)]
    assert main(["export", *sources, str(out)]) == 0
    with zipfile.ZipFile(out) as archive:
        assert archive.namelist() == ["mmaud_results.csv"]
        rows = mmaud_rows(archive.read("mmaud_results.csv").decode())
    stamps = sorted({r["timestamp"] for track in rows_of(result).values() for r in track})
    assert [row["Timestamp"] for row in rows] == stamps * 2
    assert [row["Sequence"] for row in rows] == ["seq1"] * len(stamps) + ["seq2"] * len(stamps)


def test_the_answer_scores_as_evaluate_says_it_will(result):
    """`challenge_mse` is the mean squared distance of what is handed in, stamp by stamp."""
    truth = result / "ground_truth.csv"
    stamps = [line.split(",")[0] for line in truth.read_text().splitlines()[1:]]
    (result.parent / "stamps.txt").write_text("\n".join(stamps))
    out = write(result, "mmaud_results.csv", "--at", str(result.parent / "stamps.txt"))
    rows = mmaud_rows(out.read_text())
    found = np.array([[float(v) for v in row["Position"][1:-1].split(",")] for row in rows])
    with truth.open() as file:
        error = found - positions(list(csv.DictReader(file)))
    mse = (error**2).sum(axis=1).mean()
    assert evaluate_files(truth, result / "traj.csv")["challenge_mse"] == pytest.approx(
        mse, abs=1e-4
    )


def test_a_trajectory_of_plain_positions_can_be_exported_too(tmp_path):
    plain = tmp_path / "plain.csv"
    plain.write_text("timestamp,x,y,z\n2.000000001,1,2,3\n1.5,4,5,6\n")
    for name in ("a.tum", "a.csv", "a.kml", "a.geojson", "a.bag", "a.mcap", "mmaud_results.csv"):
        out = tmp_path / name
        place = ["--origin", ORIGIN] if name in ("a.kml", "a.geojson") else []
        assert main(["export", str(plain), str(out), *place]) == 0
        assert out.stat().st_size > 0
    lines = (tmp_path / "a.tum").read_text().splitlines()
    assert lines[1:] == ["1.500000000 4.0 5.0 6.0 0 0 0 1", "2.000000001 1.0 2.0 3.0 0 0 0 1"]
    assert (tmp_path / "a.csv").read_text().splitlines()[0] == "timestamp,utc,track_id,x,y,z"


def test_no_drone_is_an_answer_but_not_for_the_challenge(tmp_path, fails):
    empty = tmp_path / "traj.csv"
    empty.write_text("timestamp,track_id,x,y,z\n")
    for name in ("a.tum", "a.csv", "a.kml", "a.geojson", "a.bag", "a.mcap"):
        assert main(["export", str(empty), str(tmp_path / name), "--origin", ORIGIN]) == 0
    assert json.loads((tmp_path / "a.geojson").read_text())["features"] == []
    assert "no track" in fails(4, "export", empty, tmp_path / "mmaud_results.csv")
    assert not (tmp_path / "mmaud_results.csv").exists()


def test_what_does_not_fit_together_is_refused(result, tmp_path, fails):
    fails(2, "export", result, tmp_path / "a.xyz")
    assert "--origin" in fails(2, "export", result, tmp_path / "a.kml")
    fails(2, "export", result, tmp_path / "a.kml", "--origin", "91,0,0")
    fails(2, "export", result, tmp_path / "a.kml", "--origin", "1,2")
    fails(2, "export", result, result, tmp_path / "a.tum")
    fails(2, "export", result, tmp_path / "a.tum", "--at", tmp_path / "x")
    fails(2, "export", result)
    far = tmp_path / "map.csv"
    far.write_text("timestamp,track_id,x,y,z\n1.0,0,465000.0,5247000.0,420.0\n")
    for suffix in ("kml", "geojson", "courageous.json", "csv"):
        said = fails(4, "export", far, tmp_path / f"a.{suffix}", "--origin", "47,8,0")
        assert "map.csv: a row is 5247 km from --origin, expected" in said
    for form in ("tum", "mcap"):
        told = fails(2, "export", result, "--to", "/", "--format", form)
        assert "'/' is a folder, expected the name" in told
    fails(4, "export", tmp_path / "absent.csv", tmp_path / "a.tum")
    fails(4, "export", result, tmp_path / "a.bag", "--points", tmp_path / "absent.pcd")
    (tmp_path / "t.csv").write_text("Sequence,Timestamp\nother,1.5\n")
    out = tmp_path / "mmaud_results.csv"
    assert "'other'" in fails(2, "export", result, out, "--at", tmp_path / "t.csv")
    (tmp_path / "t.csv").write_text("Sequence,Time\nother,1.5\n")
    assert "Timestamp" in fails(4, "export", result, out, "--at", tmp_path / "t.csv")
    (tmp_path / "t.csv").write_text("Sequence,Timestamp\nflight,soon\n")
    assert "'soon'" in fails(4, "export", result, out, "--at", tmp_path / "t.csv")
    for text in ("", "\n\n", "Sequence,Timestamp\n"):
        (tmp_path / "t.csv").write_text(text)
        assert "no stamp" in fails(4, "export", result, out, "--at", tmp_path / "t.csv")
    (tmp_path / "traj.csv").write_text("timestamp,track_id,x,y,z\n1,0.5,1,2,3\n")
    assert "0.5" in fails(4, "export", tmp_path / "traj.csv", tmp_path / "a.tum")
    assert not (tmp_path / "a.tum").exists()
