#!/usr/bin/env python3
"""Makes a bag of a given size and measures how fast and in how much memory it is converted.

The conversion runs in a process of its own on one core. Prints MB of bag per second and the peak
memory; exit code 1 if it is slower than 50 MB/s or takes more than 300 MB.
"""

import argparse
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore
from unlidar.conversion.message_types import register_livox

_LEAST_MB_PER_S = 50.0
_MOST_MB = 300.0
_BEGIN_NS = 1_706_255_621_000_000_007
_ROWS = 40_000  # of a message, as a spinning LiDAR of 32 beams sends
_FIELDS = (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 16, 7), ("t", 20, 6))
_STEP = 32


def point_cloud(store: Typestore, header: object) -> tuple[str, object]:
    """A PointCloud2 of x, y, z, intensity and t in rows of 32 bytes, a third without return."""
    rng = np.random.default_rng(1)
    rows = np.zeros((_ROWS, _STEP // 4), dtype="<f4")
    rows[:, :3] = rng.normal(0, 30, (_ROWS, 3))
    rows[::3, :3] = 0
    rows.view("<u4")[:, 5] = np.linspace(0, 10**8, _ROWS)
    field = store.types["sensor_msgs/msg/PointField"]
    name = "sensor_msgs/msg/PointCloud2"
    return name, store.types[name](
        header=header,
        height=1,
        width=_ROWS,
        fields=[field(*description, 1) for description in _FIELDS],
        is_bigendian=False,
        point_step=_STEP,
        row_step=rows.nbytes,
        data=rows.view("u1").reshape(-1),
        is_dense=False,
    )


def livox(store: Typestore, header: object) -> tuple[str, object]:
    """A CustomMsg, a third of its points without return."""
    xyz = np.random.default_rng(1).normal(0, 30, (_ROWS, 3))
    xyz[::3] = 0
    point = store.types["livox_ros_driver2/msg/CustomPoint"]
    name = "livox_ros_driver2/msg/CustomMsg"
    points = [point(i * 2500, *map(float, row), 9, 16, 1) for i, row in enumerate(xyz)]
    return name, store.types[name](header, 0, _ROWS, 1, np.zeros(3, dtype="u1"), points)


def make_bag(folder: Path, kind: str, cloud: str, megabytes: float) -> Path:
    """A bag of one cloud again and again, ten a second by its stamps."""
    is_ros1 = kind == "ros1"
    store = register_livox(get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE))
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    path = folder / ("flight.bag" if is_ros1 else "flight")
    writer = Writer1(path) if is_ros1 else Writer2(path, version=9, storage_plugin=plugin)
    stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    sequence = {"seq": 0} if is_ros1 else {}
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="lidar", **sequence)
    name, message = (livox if cloud == "livox" else point_cloud)(store, header)
    packed = bytearray((store.serialize_ros1 if is_ros1 else store.serialize_cdr)(message, name))
    with writer:
        topic = writer.add_connection("/points", name, typestore=store)
        for i in range(max(1, round(megabytes * 1e6 / len(packed)))):
            stamp_ns = _BEGIN_NS + i * 100_000_000
            packed[4:12] = struct.pack("<II", *divmod(stamp_ns, 10**9))  # behind seq or CDR's head
            writer.write(topic, stamp_ns, bytes(packed))
    return path


# VmHWM counts from the start of the program; ru_maxrss would hold that of the calling process.
_CHILD = """
import os, re, sys
from pathlib import Path
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from unlidar.cli import main
code = main(["convert", *sys.argv[1:]])
print(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])
sys.exit(code)
"""


def measure(bag: Path, out: Path) -> tuple[float, float]:
    """Seconds and peak megabytes of the conversion, on one core."""
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, bag, out], check=True, stdout=subprocess.PIPE, text=True
    )
    return time.perf_counter() - begin, int(done.stdout.split()[-1]) / 1000


def main() -> int:
    """Makes, measures, prints and removes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", choices=("ros1", "mcap", "db3"), default="ros1")
    parser.add_argument("--cloud", choices=("pointcloud2", "livox"), default="pointcloud2")
    parser.add_argument("--megabytes", type=float, default=2000.0, help="default: 2000")
    parser.add_argument("--folder", type=Path, help="for the bag (default: the system's)")
    chosen = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="measure_convert-", dir=chosen.folder))
    try:
        bag = make_bag(folder, chosen.kind, chosen.cloud, chosen.megabytes)
        files = [bag] if bag.is_file() else list(bag.iterdir())
        megabytes = sum(file.stat().st_size for file in files) / 1e6
        seconds, memory = measure(bag, folder / "out")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    rate = megabytes / seconds
    print(
        f"{chosen.kind}, {chosen.cloud}: {megabytes:.0f} MB of bag in {seconds:.1f} s, "
        f"{rate:.0f} MB/s, at most {memory:.0f} MB of memory"
    )
    return int(rate < _LEAST_MB_PER_S or memory > _MOST_MB)


if __name__ == "__main__":
    sys.exit(main())
