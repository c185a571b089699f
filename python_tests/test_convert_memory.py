"""A long bag needs no more memory than a short one. For big ones: tools/measure_convert.py."""

from pathlib import Path

import pytest
from bags import BEGIN_NS, plain_cloud, random_points, text, write_bag
from scripts import load_script
from unlidar.conversion import list_streams

TOOL = Path(__file__).parents[1] / "tools/measure_convert.py"


@pytest.fixture(scope="module")
def tool():
    return load_script(TOOL)


@pytest.mark.parametrize(
    ("kind", "cloud"),
    [("ros1", "pointcloud2"), ("mcap", "pointcloud2"), ("db3", "pointcloud2"), ("ros1", "livox")],
)
def test_a_long_bag_takes_no_more_memory_than_a_short_one(kind, cloud, tool, tmp_path):
    peaks = []
    for name, megabytes in (("short", 5), ("long", 60)):
        (tmp_path / name).mkdir()
        bag = tool.make_bag(tmp_path / name, kind, cloud, megabytes)
        peaks.append(tool.measure(bag, tmp_path / name / "out")[1])
    assert peaks[1] - peaks[0] < 20
    assert peaks[1] < 300


def test_messages_that_nobody_reads_are_counted_and_take_next_to_no_memory(tool, tmp_path):
    peaks = []
    for words in (10, 60_000):
        clouds = [plain_cloud("/p", BEGIN_NS, random_points(1))]
        others = [text("/words", BEGIN_NS + i) for i in range(words)]
        bag = write_bag(tmp_path, "ros1", clouds + others, f"flight{words}")
        counts = {stream.name: stream.items for stream in list_streams(bag)[1]}
        assert counts == {"/p": 1, "/words": words}
        peaks.append(tool.measure(bag, tmp_path / f"out{words}")[1])
    assert peaks[1] - peaks[0] < 3  # MB; an entry of the index for each would be 10
