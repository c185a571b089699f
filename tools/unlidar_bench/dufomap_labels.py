"""DUFOMap over a recording: which returns move, by the space that rays have seen empty.

    python -m unlidar_bench.dufomap_labels OUT VOXEL_M FRAMES_DIR

OUT is a .npz: `moves`, a flag for each return, frame by frame; `cpu_s`, what its calls alone took.
"""

import sys
import time
from pathlib import Path

import dufomap
import numpy as np
from unlidar.frames_io import list_frames, read_returns

HITS_M, UNKNOWN_VOXELS = 0.2, 1  # d_s and d_p, as in its paper and its assets/config.toml


def main(arguments: list[str]) -> int:
    """The exit code."""
    out, voxel_m, folder = Path(arguments[0]), float(arguments[1]), Path(arguments[2])
    clouds = [read_returns(frame.path).astype(np.float32) for frame in list_frames(folder)]
    pose = np.eye(4)  # the sensor stands still, where the axes begin
    begin = time.process_time()
    space = dufomap.dufomap(voxel_m, HITS_M, UNKNOWN_VOXELS, num_threads=1)
    for cloud in clouds:
        space.run(cloud, pose, cloud_transform=False)
    space.oncePropagateCluster(if_propagate=True, if_cluster=False)
    moves = [space.segment(cloud, pose, cloud_transform=False) for cloud in clouds]
    cpu_s = time.process_time() - begin
    np.savez(out, moves=np.concatenate(moves).astype(bool), cpu_s=cpu_s)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
