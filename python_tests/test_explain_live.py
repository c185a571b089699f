"""`unlidar explain --live`: traces of streams by hand, and of the program."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from rejections import NEAR_GROUND
from synthetic import BEGIN_NS as FLIGHT_NS
from synthetic import decimal_name, make_flight, seconds, truth_m, write_frames, write_pcd
from unlidar.cli import main
from unlidar.errors import InputError
from unlidar.explain.evidence import Collector, SensorFrames
from unlidar.explain.stages import measured, runs_of, stage_of
from unlidar.explain.targets import Reach, named_place
from unlidar.explain.trace import read_trace
from unlidar.mounting import Mounting
from unlidar.record import EXPLANATION

SECOND_NS = 1_000_000_000
BEGIN_NS = 1_700_000_000 * SECOND_NS
DRONE_M = (10.0, 0.0, 5.0)
PER_SECOND = 4


class Stream:
    """The trace of a stream with one sensor, a second at a time, and what is told of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.files: dict[int, Path] = {}
        self.lines = [{"trace": "header", "version": "1", "method": "robust", "sensors": []}]

    def second(self, index: int, frame: str | None = None, **of_detection: object) -> None:
        """Frames with one detection each; `frame`: why they are not searched."""
        for stamp_ns in self.stamps_ns(index):
            self.files[stamp_ns] = self.folder / f"{seconds(stamp_ns)}.pcd"
            write_pcd(self.files[stamp_ns], np.array([DRONE_M], dtype="f4"))
            found = {"returns": 2, "height_m": 5.0, "log_clutter": -10.5, "unsupported": True}
            found |= dict(zip("xyz", DRONE_M, strict=True)) | of_detection
            self.lines.append({
                "trace": "frame", "sensor": "lidar", "stamp": seconds(stamp_ns),
                "middle": seconds(stamp_ns), "returns": 1, "bodies": [], "detections": [found],
                "threshold": 20.0, "rejection": frame,
            })  # fmt: skip

    def path(self, first: int, last: int, rejection: str | None, **more: object) -> None:
        """A path through all frames of these seconds."""
        stamps_ns = [s for index in range(first, last) for s in self.stamps_ns(index)]
        detections = [[seconds(stamp_ns), *DRONE_M] for stamp_ns in stamps_ns]
        self.lines.append({
            "trace": "path", "first": detections[0][0], "last": detections[-1][0],
            "log_likelihood_ratio": 25.0, "crowding_penalty": 0.0, "threshold": 20.0,
            "rejection": rejection, "detections": detections, "cuts": [], "track": None, **more,
        })  # fmt: skip

    def track(self, number: int, state: str, rejection: str | None = None) -> None:
        self.lines.append({
            "trace": "track", "at": seconds(BEGIN_NS), "track": number, "state": state,
            "rejection": rejection, "first": seconds(BEGIN_NS), "last": seconds(BEGIN_NS),
        })  # fmt: skip

    def collector(self) -> Collector:
        trace = self.folder / "trace.jsonl"
        trace.write_text("".join(json.dumps(line) + "\n" for line in self.lines))
        sensors = {"lidar": SensorFrames(self.files, Mounting())}
        collector = Collector([named_place(DRONE_M)], sensors, Reach([Mounting()], 1.0))
        collector.add_trace(read_trace(trace))
        return collector

    def stages(self) -> list[str]:
        found = self.collector().found[0]
        return [stage_of(found[begin_ns]) for begin_ns in sorted(found)]

    @staticmethod
    def stamps_ns(index: int) -> list[int]:
        begin_ns = BEGIN_NS + index * SECOND_NS
        return [begin_ns + k * SECOND_NS // PER_SECOND for k in range(PER_SECOND)]


@pytest.fixture
def stream(tmp_path: Path) -> Stream:
    return Stream(tmp_path)


def test_each_detection_has_the_decision_of_its_frame(stream: Stream) -> None:
    stream.second(0, frame="warm_up")
    stream.second(1)
    stream.second(2, log_likelihood_ratio=12.5, rejection="below_threshold")
    stream.second(3, log_likelihood_ratio=25.0, rejection="stationary")
    assert stream.stages() == ["unsearched", "detection", "path", "gate stationary"]
    runs = runs_of(stream.collector().found[0])
    assert runs[2].evidence.path.log_likelihood_ratio == 12.5
    assert runs[3].evidence.path.detections == PER_SECOND


def test_clutter_without_bound_is_no_number_and_is_said(stream: Stream) -> None:
    stream.second(0, log_clutter=None)
    stream.second(1)
    unbounded, bounded = (
        measured(stream.collector().found[0][BEGIN_NS + k * SECOND_NS], "detection") for k in (0, 1)
    )
    assert unbounded == "4 detections (4 unsupported), 4 amid clutter without bound, no path"
    assert bounded == "4 detections (4 unsupported), mean log clutter -10.5, no path"


def test_a_detection_above_unseen_ground_has_no_height(stream: Stream) -> None:
    stream.second(0, height_m=None)
    assert stream.stages() == ["detection"]


def test_what_a_rule_cut_off_is_told_by_this_rule_and_the_rest_by_that_of_the_path(
    stream: Stream,
) -> None:
    for k in range(4):
        stream.second(k)
    cuts = [["pause", PER_SECOND], ["near_ground", PER_SECOND]]
    stream.path(0, 4, "too_few_detections", cuts=cuts)
    assert stream.stages() == [
        "gate pause", "gate near_ground", "gate too_few_detections", "gate too_few_detections",
    ]  # fmt: skip


def test_a_track_that_waits_is_refused_by_its_rule_until_it_is_confirmed(stream: Stream) -> None:
    stream.second(0)
    stream.path(0, 1, None, track=3)
    stream.track(3, "initiated")
    stream.track(3, "waiting", "suspended")
    stream.second(1, track=3)
    assert stream.stages() == ["gate suspended", "gate suspended"]
    stream.track(3, "confirmed")
    stream.second(2, track=3)
    assert stream.stages() == ["track", "gate suspended", "track"]


def test_a_track_without_a_rule_is_a_track_also_before_its_first_decision(stream: Stream) -> None:
    stream.second(0)
    stream.path(0, 1, None, track=0)
    stream.track(0, "initiated")
    assert stream.stages() == ["track"]
    stream.track(0, "rejected", "cloud")
    assert stream.stages() == ["gate cloud"]


def test_a_frame_of_another_sensor_is_refused(stream: Stream) -> None:
    stream.second(0)
    stream.lines[-1]["sensor"] = "avia"
    with pytest.raises(InputError, match="avia"):
        stream.collector()


def test_a_path_that_several_seconds_share_counts_the_detections_of_each(stream: Stream) -> None:
    for k in range(3):
        stream.second(k, log_likelihood_ratio=25.0 - k, rejection="near_ground")
    stream.path(0, 3, "near_ground")
    (run,) = runs_of(stream.collector().found[0])
    assert run.evidence.path.detections == PER_SECOND


# --- with the program ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("flown")
    write_frames(root / "flight/lidar", make_flight(frames=90), decimal_name)
    times_ns = [FLIGHT_NS + k * SECOND_NS // 20 for k in range(180)]
    rows = zip(times_ns, truth_m([t * 1e-9 for t in times_ns]), strict=True)
    (root / "flight/ground_truth.csv").write_text(
        "timestamp,x,y,z\n"
        + "".join(f"{seconds(t)},{','.join(map(str, place))}\n" for t, place in rows)
    )
    return root / "flight"


def test_the_program_explains_a_flight_as_a_stream_and_leaves_the_page_alone(
    recording, program, monkeypatch, explained, tmp_path
) -> None:
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    out = tmp_path / "out"
    assert main(["run", str(recording), "--out", str(out), "--no-report"]) == 0
    (target,) = explained(out, "--live")
    assert target["shares"].get("found", 0) > 0.9
    assert not (out / EXPLANATION).exists()
    wall = explained(out, "--live", "--near=20,0,1", "--radius=0.5")[0]
    assert wall["shares"].get("structure", 0) > 0.8


@pytest.mark.parametrize(
    ("options", "stage"),
    [
        (("--set", "robust.min_plots=1000"), "gate too_few_detections"),
        (NEAR_GROUND, "gate near_ground"),
    ],
)
def test_the_rule_by_which_a_stream_loses_the_drone_is_named(
    options, stage, recording, program, monkeypatch, explained, tmp_path
) -> None:
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    out = tmp_path / "out"
    assert main(["run", str(recording), "--out", str(out), "--no-report", *options]) == 0
    (target,) = explained(out, "--live")
    assert target["shares"].get(stage, 0) > 0.7, target["shares"]


def test_an_endless_delay_has_no_trace(recording, program, monkeypatch, fails, tmp_path) -> None:
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    out = tmp_path / "out"
    endless = ["--set", "live.delay_s=.inf"]
    assert main(["run", str(recording), "--out", str(out), "--no-report", *endless]) == 0
    assert "expected a finite delay with --trace" in fails(3, "explain", out, "--live")
