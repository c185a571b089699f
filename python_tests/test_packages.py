"""The packages that tools/package.sh makes: what is in them, and that they work where they end up.

They are made of the build in build/ and with the project's .venv, as tools/test.sh leaves them.
"""

from __future__ import annotations

import gzip
import json
import os
import platform
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import sysconfig
import tarfile
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from live_program import PATIENCE_S, messages, rows_of
from synthetic import PROJECT, make_flight, truth_m, write_frames

MAX_CLOSURE_KB = 60_000
MAX_WHEEL_BYTES = 40_000_000
MADE_BY = ("cpack", "dpkg-deb", "dpkg-shlibdeps", "file", "help2man")


def needs(*tools: str) -> pytest.MarkDecorator:
    missing = [tool for tool in tools if shutil.which(tool) is None]
    return pytest.mark.skipif(bool(missing), reason=f"not installed: {' '.join(missing)}")


def output_of(*command: str | Path, **options) -> str:
    done = subprocess.run(
        command, capture_output=True, text=True, stdin=subprocess.DEVNULL, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@dataclass(frozen=True)
class Packages:
    program: Path
    library: Path
    wheel: Path
    sources: Path
    version: str


def programs_of(folder: Path, *lists: str) -> Path:
    """A folder with the programs of a Debian that has these lists of packages of setup.sh."""
    asked = "source tools/setup.sh; for l; do declare -n p=$l; echo ${p[*]}; done"
    named = output_of("bash", "-c", asked, "bash", *lists, cwd=PROJECT).split()
    priorities = output_of("dpkg-query", "--show", "--showformat=${Package}\t${Priority}\n")
    required = [line.split()[0] for line in priorities.splitlines() if line.endswith("\trequired")]
    packages = {*closure_kb(Path("/"), *named, *required)}
    theirs = {Path(p).resolve() for p in output_of("dpkg-query", "--listfiles", *packages).split()}
    folder.mkdir()
    for place in ("/usr/sbin", "/usr/bin"):
        for program in Path(place).iterdir():
            if program.resolve() in theirs and not (folder / program.name).exists():
                (folder / program.name).symlink_to(program)
    return folder


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Packages:
    missing = [tool for tool in MADE_BY if shutil.which(tool) is None]
    left_behind = (PROJECT / "build/unlidar_track", PROJECT / ".venv/unlidar.stamp")
    missing += [str(path) for path in left_behind if not path.is_file()]
    if missing:
        pytest.skip(f"packages cannot be made quickly without {', '.join(missing)}")
    # Other packages of this machine must not lend what those that are installed for it lack.
    programs = programs_of(
        tmp_path_factory.mktemp("debian") / "bin", "build_packages", "package_packages"
    )
    # CPack looks beyond PATH.
    assert [tool for tool in MADE_BY if not (programs / tool).exists()] == []
    output_of(PROJECT / "tools/package.sh", env=os.environ | {"PATH": str(programs)})
    made = sorted((PROJECT / "out/packages").iterdir())
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    version = output_of(PROJECT / "build/unlidar_track", "--version").split()[1]
    architecture = output_of("dpkg", "--print-architecture").strip()
    library, program, wheel, sources = made
    assert library.name == f"libunlidar-dev_{version}_{architecture}.deb"
    assert program.name == f"unlidar-track_{version}_{architecture}.deb"
    tags = rf"{python}-{python}-manylinux_2_\d+_{platform.machine()}"
    assert re.fullmatch(rf"unlidar_track-{re.escape(version)}-{tags}\.whl", wheel.name)
    assert sources.name == f"unlidar_track-{version}.tar.gz"
    return Packages(program, library, wheel, sources, version)


@pytest.fixture(scope="module")
def installed(packages: Packages, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A root with the files of unlidar-track and nothing else."""
    root = tmp_path_factory.mktemp("root")
    output_of("dpkg-deb", "--extract", packages.program, root)
    return root


def files_in(package: Path) -> dict[str, tarfile.TarInfo]:
    archive = subprocess.run(
        ["dpkg-deb", "--fsys-tarfile", package], capture_output=True, check=True
    )
    with tarfile.open(fileobj=BytesIO(archive.stdout)) as tar:
        return {info.name.removeprefix("."): info for info in tar if not info.isdir()}


# --- Debian packages ----------------------------------------------------------------------------


def test_the_package_of_the_program_has_what_a_station_needs_and_no_more(
    packages: Packages,
) -> None:
    files = files_in(packages.program)
    configs = "/usr/share/unlidar_track/configs/"
    assert {name for name in files if not name.startswith(configs)} == {
        "/etc/logrotate.d/unlidar-track",
        "/etc/unlidar/station.yaml",
        "/lib/systemd/system/unlidar-track.service",
        "/usr/bin/unlidar_track",
        "/usr/share/bash-completion/completions/unlidar_track",
        "/usr/share/doc/unlidar-track/changelog.gz",
        "/usr/share/doc/unlidar-track/copyright",
        "/usr/share/man/man1/unlidar_track.1.gz",
    }
    assert configs + "default.yaml" in files
    assert {(info.uname, info.gname) for info in files.values()} == {("root", "root")}
    conffiles = output_of("dpkg-deb", "--info", packages.program, "conffiles").split()
    assert conffiles == [name for name in sorted(files) if name.startswith("/etc/")]
    # What the program is built with and does not call, as PCL's other libraries and VTK, which are
    # 449 MB.
    needed = output_of("dpkg-deb", "--field", packages.program, "Depends")
    assert re.findall(r"libpcl-[a-z]+", needed) == ["libpcl-common"]
    assert "vtk" not in needed and "-dev" not in needed
    # Debian's Ceres is a static library, which is a part of the program, without the solvers that
    # nothing asks it for.
    assert not re.search("ceres|cholmod|cxsparse|lapack|atlas|blas", needed)
    needed = output_of("dpkg-deb", "--field", packages.library, "Depends")
    assert "libceres-dev" in needed and "pcl" not in needed


def test_the_package_of_the_api_has_headers_library_and_cmake_configuration(
    packages: Packages,
) -> None:
    files = files_in(packages.library)
    headers = {path.name for path in (PROJECT / "include/unlidar").iterdir()}
    assert {Path(f).name for f in files if f.startswith("/usr/include/unlidar/")} == headers
    assert "/usr/lib/libunlidar_core.a" in files
    assert "/usr/lib/cmake/unlidar_track/unlidar_trackConfig.cmake" in files


@needs("lintian")
def test_lintian_has_nothing_to_say(packages: Packages) -> None:
    said = output_of(
        "lintian", "--fail-on=warning", "--allow-root", packages.program, packages.library
    )
    assert said == ""


def test_the_manual_page_lists_every_option(packages: Packages, installed: Path) -> None:
    source = gzip.decompress((installed / "usr/share/man/man1/unlidar_track.1.gz").read_bytes())
    page = source.decode().replace("\\-", "-")
    shown = output_of(installed / "usr/bin/unlidar_track", "--help")
    options = set(re.findall(r"^  (?:-h,)?(--[a-z]+)", shown, re.MULTILINE))
    assert len(options) > 15 and [o for o in options if o not in page] == []
    assert f"unlidar_track {packages.version}" in page


def test_options_are_completed(installed: Path) -> None:
    library = Path("/usr/share/bash-completion/bash_completion")
    if not library.is_file():
        pytest.skip("not installed: bash-completion")
    script = installed / "usr/share/bash-completion/completions/unlidar_track"
    asked = f"""
      source {library}; source {shlex.quote(str(script))}
      COMP_WORDS=(unlidar_track --li) COMP_CWORD=1 COMP_LINE='unlidar_track --li' COMP_POINT=18
      _longopt unlidar_track --li unlidar_track; echo "${{COMPREPLY[@]}}"
    """
    path = f"{installed / 'usr/bin'}:{os.environ['PATH']}"
    proposed = output_of("bash", "-c", asked, env=os.environ | {"PATH": path})
    assert set(proposed.split()) == {"--livox"}


# --- The service --------------------------------------------------------------------------------


def unit_of(root: Path) -> str:
    return (root / "lib/systemd/system/unlidar-track.service").read_text()


@needs("systemd-analyze")
def test_systemd_finds_no_fault_in_the_unit_and_little_that_it_may(
    installed: Path, tmp_path: Path
) -> None:
    unit = tmp_path / "unlidar-track.service"
    unit.write_text(unit_of(installed).replace("=/usr/bin/", f"={installed}/usr/bin/"))
    verified = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True)
    assert (verified.returncode, verified.stderr) == (0, "")
    told = output_of("systemd-analyze", "security", "--offline=yes", "--no-pager", unit)
    assert float(re.search(r"Overall exposure level for \S+: ([0-9.]+)", told)[1]) < 2


def test_the_unit_starts_nothing_but_the_program_and_the_shell_that_every_debian_has(
    packages: Packages, installed: Path
) -> None:
    unit = unit_of(installed)
    started = re.findall(r"^Exec[A-Za-z]+=[-@:+!]*(\S+)", unit, re.MULTILINE)
    assert {*started} == {"/usr/bin/unlidar_track", "/bin/sh"}
    (told,) = re.findall(r"^Documentation=(.*)$", unit, re.MULTILINE)
    scheme, _, path = told.partition(":")
    assert scheme == "file" and path in files_in(packages.program)
    # A reload reaches the process whose number systemd puts in.
    (reload,) = re.findall(r"^ExecReload=(.*)$", unit, re.MULTILINE)
    process = subprocess.Popen(["sleep", "60"])
    output_of(*shlex.split(reload.replace("${MAINPID}", str(process.pid))), env={"PATH": ""})
    assert process.wait(PATIENCE_S) == -signal.SIGHUP


def test_logs_are_rotated_as_the_user_of_the_service_who_is_there_for_good(installed: Path) -> None:
    unit = unit_of(installed)
    (user,) = re.findall(r"^User=(.*)$", unit, re.MULTILINE)
    # A dynamic one has no name while the service does not run, and cannot enter its own folder.
    assert "DynamicUser" not in unit
    rotated = (installed / "etc/logrotate.d/unlidar-track").read_text()
    assert re.findall(r"^\s*su (.*)$", rotated, re.MULTILINE) == [f"{user} {user}"]
    script = (PROJECT / "packaging/postinst").read_text()
    assert re.search(rf"adduser .*--system --group .* {user}$", script, re.MULTILINE)


class Manager:
    """Stands for systemd: hears what a service tells."""

    def __init__(self) -> None:
        self.name = f"@unlidar-packages-{os.getpid()}-{time.monotonic_ns()}"
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind("\0" + self.name[1:])
        self.socket.settimeout(PATIENCE_S)

    def hears(self, message: str) -> None:
        """Waits for it."""
        while self.socket.recv(4096).decode() != message:
            pass


@contextmanager
def running(root: Path, source: str, manager: Manager, *, inside: bool) -> Iterator:
    """The unit's command with another source of frames, with its files below `root`."""
    (line,) = re.findall(r"^ExecStart=(.*)$", unit_of(root), re.MULTILINE)
    command = shlex.split(line.replace("$UNLIDAR_SOURCE", source))
    for folder in ("var/lib/unlidar", "run/unlidar"):  # StateDirectory=, RuntimeDirectory=
        (root / folder).mkdir(parents=True, exist_ok=True)
    if inside:
        command = ["chroot", str(root), *command]
    else:
        command = [f"{root}{word}" if word.startswith("/") else word for word in command]
    environment = {"NOTIFY_SOCKET": manager.name, "WATCHDOG_USEC": "400000"}
    process = subprocess.Popen(
        command, env=os.environ | environment, stdin=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def check_tracking(root: Path, tmp_path: Path, *, inside: bool) -> None:
    """Starts as a service does, tracks a flight, is alive with and without frames, ends well."""
    frames = write_frames(tmp_path / "frames", make_flight())
    manager = Manager()
    with running(root, "--stdin", manager, inside=inside) as process:
        manager.hears("READY=1")
        manager.hears("WATCHDOG=1")
        process.stdin.write(b"".join(messages(lidar=frames)))
        process.stdin.flush()
        manager.hears("STATUS=running")
        manager.hears("WATCHDOG=1")
        process.send_signal(signal.SIGTERM)
        manager.hears("STOPPING=1")
        assert process.wait(PATIENCE_S) == 0
    rows = np.array(
        [row.split(",")[:5] for row in rows_of(root / "var/lib/unlidar/traj.csv")], float
    )
    assert len(rows) > 20
    errors = np.linalg.norm(rows[:, 2:5] - truth_m(rows[:, 0]), axis=1)
    assert np.sqrt(np.mean(errors**2)) < 0.2


def test_the_units_command_tracks_and_tells_systemd_that_it_is_alive(
    installed: Path, tmp_path: Path
) -> None:
    check_tracking(installed, tmp_path, inside=False)


# --- In a bare Debian 12 ------------------------------------------------------------------------


@pytest.fixture
def bare_root(tmp_path: Path) -> Path:
    """A copy of the root in the folder UNLIDAR_BARE_ROOT, which is made there if it is absent."""
    named = os.environ.get("UNLIDAR_BARE_ROOT")
    if not named:
        pytest.skip("UNLIDAR_BARE_ROOT names no folder for a bare Debian 12 (root, network)")
    if os.geteuid() != 0:
        pytest.skip("only root can install packages in UNLIDAR_BARE_ROOT")
    kept = Path(named)
    if not kept.is_dir():
        if shutil.which("debootstrap") is None:
            pytest.skip("not installed: debootstrap")
        unfinished = kept.with_name(f"{kept.name}.part-{os.getpid()}")
        output_of("debootstrap", "--variant=minbase", "bookworm", unfinished)
        unfinished.rename(kept)
    root = tmp_path / "root"
    output_of("cp", "-a", "--reflink=auto", kept, root)
    shutil.copy("/etc/resolv.conf", root / "etc/resolv.conf")
    return root


def closure_kb(root: Path, *packages: str) -> dict[str, int]:
    """Installed sizes of packages and of all that they depend on, down to the C library."""
    listed = output_of(
        "dpkg-query", f"--admindir={root}/var/lib/dpkg", "--show",
        "--showformat=${Package}\t${Installed-Size}\t${Depends}, ${Pre-Depends}\t${Provides}\n",
    )  # fmt: skip
    sizes, depends, provides = {}, {}, {}
    for line in listed.splitlines():
        name, size, needed, provided = line.split("\t")
        sizes[name], depends[name] = int(size or 0), re.split(r"[,|]", needed)
        for word in [name, *provided.split(",")]:
            provides[re.split(r"[ (:]", word.strip())[0]] = name
    reached: set[str] = set()
    waiting = [*packages]
    while waiting:
        name = provides.get(re.split(r"[ (:]", waiting.pop().strip())[0])
        if name is not None and name not in reached:
            reached.add(name)
            waiting += depends[name]
    return {name: sizes[name] for name in reached}


def check_rotation(root: Path, apt: tuple) -> None:
    """Debian's logrotate takes the files of the service, and follows none of its user's links."""
    output_of(*apt, "install", "logrotate")
    folder = root / "var/lib/unlidar"
    inside = ("chroot", root)
    output_of(*inside, "chown", "-R", "unlidar-track:unlidar-track", "/var/lib/unlidar")
    (folder / "planted.csv").symlink_to("/etc/shadow")
    before = (folder / "traj.csv").read_bytes()
    shadow = (root / "etc/shadow").stat()
    output_of(*inside, "logrotate", "--force", "/etc/logrotate.d/unlidar-track")
    assert (folder / "traj.csv.1").read_bytes() == before
    assert (root / "etc/shadow").stat() == shadow
    (folder / "planted.csv").unlink()
    (folder / "traj.csv.1").rename(folder / "traj.csv")


def test_the_package_works_in_a_bare_debian(
    packages: Packages, bare_root: Path, tmp_path: Path
) -> None:
    shutil.copy(packages.program, bare_root / "tmp")
    chroot = ("chroot", bare_root, "env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-q", "-y")
    output_of(*chroot, "update")
    output_of(*chroot, "install", f"/tmp/{packages.program.name}")
    sizes = closure_kb(bare_root, "unlidar-track")
    assert {"libc6", "libstdc++6", "libpcl-common1.13"} <= {*sizes}
    assert sum(sizes.values()) <= MAX_CLOSURE_KB, sizes
    check_tracking(bare_root, tmp_path, inside=True)
    check_rotation(bare_root, chroot)
    # What a station owner has changed and tracked outlives the package.
    output_of(*chroot, "remove", "unlidar-track")
    assert (bare_root / "etc/unlidar/station.yaml").is_file()
    output_of(*chroot, "purge", "unlidar-track")
    assert not (bare_root / "etc/unlidar").exists()
    assert (bare_root / "var/lib/unlidar/traj.csv").is_file()


IN_ROOT = 'mount -t proc proc "$0/proc"; mount --rbind /dev "$0/dev"; exec chroot "$0" "$@"'
ROOT_ENVIRONMENT = {
    "PATH": "/root/venv/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
    "HOME": "/root",
}


def in_root(root: Path, command: str, *, mount: str = "", **environment: str) -> str:
    """What a shell in that root prints; `mount` is what is to be mounted in it besides."""
    if "PIP_CERT" in os.environ:  # whom pip is to trust where the network has a proxy
        shutil.copy(os.environ["PIP_CERT"], root / "root/trusted.crt")
        environment["PIP_CERT"] = "/root/trusted.crt"
    return output_of(
        "unshare", "--mount", "bash", "-euc", mount + IN_ROOT, root,
        "bash", "-euo", "pipefail", "-c", command,
        env=ROOT_ENVIRONMENT | environment,
    )  # fmt: skip


def test_the_page_leads_from_the_box_of_parts_to_the_first_track(
    packages: Packages, bare_root: Path
) -> None:
    """Every command of docs/station.md but those for a LiDAR and systemd, as they stand there."""
    page = (PROJECT / "docs/station.md").read_text()
    section = page.partition("## From the box of parts")[2].partition("\n## ")[0]
    blocks = re.findall(r"^```sh(?: box)?\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 5
    box = bare_root / "root/box"
    box.mkdir()
    shutil.copy(packages.program, box)
    shutil.copy(packages.wheel, box)
    commands = "cd /root/box\n" + "\n".join(blocks)
    begin = time.monotonic()
    in_root(bare_root, commands, DEBIAN_FRONTEND="noninteractive")
    assert time.monotonic() - begin < 600
    assert len(rows_of(box / "traj.csv")) > 100
    assert (box / "flight.geojson").is_file()


# --- The wheel where nothing else is ------------------------------------------------------------


@pytest.fixture
def python_root(tmp_path: Path) -> Path:
    """A root with this machine's Python, what that needs, libstdc++, and nothing else."""
    if os.geteuid() != 0:
        pytest.skip("only root can enter another root")
    if subprocess.run(["unshare", "--mount", "true"], capture_output=True).returncode != 0:
        pytest.skip("this machine lets nobody mount")
    root = tmp_path / "root"
    names = closure_kb(Path("/"), "python3-venv", "libstdc++6", "bash", "coreutils")
    for folder in ("usr/bin", "usr/lib", "usr/lib64", "usr/sbin", "proc", "dev", "tmp", "root"):
        (root / folder).mkdir(parents=True)
    for link in ("bin", "lib", "lib64", "sbin"):
        (root / link).symlink_to(f"usr/{link}")
    listed = output_of("dpkg-query", "--listfiles", *names).split("\n")
    files = {path for path in listed if Path(path).is_symlink() or Path(path).is_file()}
    files = {path for path in files if not path.startswith(("/usr/share/doc/", "/usr/share/man/"))}
    packed = subprocess.run(
        ["tar", "--create", "--no-recursion", "--files-from=-"],
        input="\n".join(sorted(files)).encode(), capture_output=True, check=True,
    )  # fmt: skip
    subprocess.run(
        ["tar", "--extract", "--keep-directory-symlink", "--directory", root],
        input=packed.stdout, capture_output=True, check=True,
    )  # fmt: skip
    return root


def check_newcomer(root: Path, mount: str = "") -> None:
    """A recording is simulated and run, then the README's Python lines, as they stand there."""
    readme = (PROJECT / "README.md").read_text()
    (lines,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    (root / "root/lines.py").write_text(lines)
    assert [name for name in ("gcc", "c++", "cmake") if (root / "usr/bin" / name).exists()] == []
    found = {path.name for path in (root / "usr/lib").rglob("*.so*")}
    assert [name for name in found if re.match("lib(pcl|ceres|glog|yaml|boost)", name)] == []
    commands = "cd /root; unlidar simulate demo flight.bag; unlidar run flight.bag; python lines.py"
    said = in_root(root, commands, mount=mount)
    results = root / "root/out/run/flight.bag"
    assert json.loads((results / "evaluation.json").read_text())["rmse"] < 0.2
    assert (results / "report.html").is_file()
    assert re.search(r"^0 0\.\d+ \[17000000", said, re.MULTILINE)  # id, drone, stamps


def test_the_wheel_needs_nothing_but_python(packages: Packages, python_root: Path) -> None:
    """And what it depends on, all of it Python packages, which it borrows from this environment."""
    shutil.copy(packages.wheel, python_root / "root")
    borrowed = python_root / "borrowed"
    borrowed.mkdir()
    install = "pip install --no-deps --no-index *.whl"
    in_root(python_root, f"cd /root; python3 -m venv venv; {install}")
    (libraries,) = python_root.glob("root/venv/lib/python3*/site-packages")
    (libraries / "borrowed.pth").write_text("/borrowed\n")
    own = shlex.quote(sysconfig.get_paths()["purelib"])
    check_newcomer(python_root, f'mount --bind {own} "$0/borrowed"; ')


def test_pip_installs_the_wheel_in_a_bare_debian(packages: Packages, bare_root: Path) -> None:
    shutil.copy(packages.wheel, bare_root / "root")
    apt = "apt-get -q -y"
    install = f"{apt} update; {apt} install --no-install-recommends python3-venv"
    in_root(bare_root, install, DEBIAN_FRONTEND="noninteractive")
    in_root(bare_root, "cd /root; python3 -m venv venv; pip install ./*.whl")
    check_newcomer(bare_root)


# --- The wheel ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def unlidar(packages: Packages, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command in an environment of its own, which borrows what it depends on from this one."""
    venv = tmp_path_factory.mktemp("wheel") / "venv"
    output_of(sys.executable, "-m", "venv", "--without-pip", venv)
    python = venv / "bin/python"
    (libraries,) = venv.glob("lib/python*/site-packages")
    (libraries / "borrowed.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    output_of(
        sys.executable, "-m", "pip", "--python", python, "--disable-pip-version-check", "install",
        "--no-deps", "--no-index", packages.wheel,
    )  # fmt: skip
    return venv / "bin/unlidar"


def run_unlidar(
    unlidar: Path, folder: Path, *arguments: str, program: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Outside the project, with the program in this folder or without it."""
    path = "/usr/bin:/bin" if program is None else f"{program}:/usr/bin:/bin"
    return subprocess.run(
        [unlidar, *arguments],
        capture_output=True,
        text=True,
        cwd=folder,
        env={"PATH": path, "HOME": str(folder)},
    )


@pytest.fixture(scope="module")
def sky(unlidar: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the wheel has simulated a flight."""
    folder = tmp_path_factory.mktemp("sky")
    simulated = run_unlidar(unlidar, folder, "simulate", "demo", "flight")
    assert simulated.returncode == 0, simulated.stderr
    return folder


def test_the_wheel_is_whole(packages: Packages, unlidar: Path, sky: Path) -> None:
    shown = run_unlidar(unlidar, sky, "--version")
    assert shown.stdout == f"unlidar {packages.version}\n", shown.stderr
    assert "simulate" in run_unlidar(unlidar, sky, "--help").stdout
    asked = "import unlidar.configs as c; print(c.CONFIG_DIR)"
    configs = Path(output_of(unlidar.with_name("python"), "-c", asked, cwd=sky).strip())
    assert configs.is_relative_to(unlidar.parents[1])
    mine = {path.relative_to(configs) for path in configs.rglob("*.*")}
    assert mine == {
        path.relative_to(PROJECT / "configs") for path in (PROJECT / "configs").rglob("*.*")
    }


def test_the_wheel_brings_all_that_it_links_but_what_every_linux_has(packages: Packages) -> None:
    assert packages.wheel.stat().st_size <= MAX_WHEEL_BYTES
    with zipfile.ZipFile(packages.wheel) as archive:
        names = archive.namelist()
    assert "unlidar/bin/unlidar_track" in names
    assert [name for name in names if re.fullmatch(r"unlidar/_engine\..*\.so", name)]
    assert "unlidar/_engine.pyi" in names and "unlidar/py.typed" in names
    shown = output_of(sys.executable, "-m", "auditwheel", "show", packages.wheel)
    tag = packages.wheel.stem.rpartition("-")[2]
    assert re.search(rf'following platform\s+tag:\s+"{tag}"', shown), shown


# Of libraries compiled into what is in the wheel, and of those in it by themselves: what their
# licences say.
COMPILED_IN = {
    "libceres": "BSD-3-Clause",
    "libcli11": "BSD-3-clause",
    "libeigen3": "MPL-2",
    "libflann": "BSD-3-clause",
    "nlohmann-json3": "Expat",
    "pybind11": "BSD-3-Clause",
}
SHARED = {
    "libgflags2.2": "BSD-3-Clause",
    "libgomp1": "GCC RUNTIME LIBRARY EXCEPTION",
    "libgoogle-glog0v6": "BSD-3-Clause",
    "liblz4-1": "BSD-2-clause",
    "liblzma5": "PD",
    "libpcl-common1.13": "BSD-3-clause",
    "libunwind8": "Expat",
    "libyaml-cpp0.7": "X11",
}


def test_the_wheel_has_the_licence_of_each_library_in_it(packages: Packages) -> None:
    with zipfile.ZipFile(packages.wheel) as archive:
        names = archive.namelist()
        record = archive.read(next(n for n in names if n.endswith(".dist-info/RECORD"))).decode()
        texts = {
            Path(name).stem: archive.read(name).decode()
            for name in names
            if ".dist-info/licenses/" in name and not name.endswith("/")
        }
    assert texts.pop("LICENSE") == (PROJECT / "LICENSE").read_text()
    libraries = {name for name in names if re.match(r"unlidar_track\.libs/.", name)}
    assert {*texts} <= {*COMPILED_IN, *SHARED}
    assert {*COMPILED_IN} <= {*texts} and len(texts) == len(COMPILED_IN) + len(libraries)
    for name, text in texts.items():
        assert (COMPILED_IN | SHARED)[name] in text, name
    for name in (*libraries, *(n for n in names if "/licenses/" in n)):
        assert name.endswith("/") or f"\n{name},sha256=" in record


# --- The source distribution --------------------------------------------------------------------


@pytest.fixture(scope="module")
def sources(packages: Packages, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that it unpacks to."""
    folder = tmp_path_factory.mktemp("sources")
    output_of("tar", "--extract", "--file", packages.sources, "--directory", folder)
    return folder / packages.sources.name.removesuffix(".tar.gz")


def files_below(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_the_sources_are_files_of_the_project_as_they_are(sources: Path) -> None:
    made = {"PKG-INFO", "setup.cfg"}
    files = {name for name in files_below(sources) - made if ".egg-info/" not in name}
    if (PROJECT / ".git").exists():
        listed = ("git", "ls-files", "--cached", "--others", "--exclude-standard")
        assert files <= {*output_of(*listed, cwd=PROJECT).splitlines()}
    changed = [n for n in files if (sources / n).read_bytes() != (PROJECT / n).read_bytes()]
    assert changed == []
    assert {"CMakeLists.txt", "LICENSE", "README.md", "pyproject.toml", "setup.py"} <= files
    # What nothing of a wheel is made of.
    others = ("docs/", "python_tests/", "src/tests/", "src/fuzz/", "src/bench/", ".")
    assert [name for name in files if name.startswith(others)] == []


def test_the_sources_have_all_that_the_wheel_is_built_of(sources: Path) -> None:
    """As the build in build/ has noted it."""
    build = PROJECT / "build"
    if shutil.which("ninja") is None:
        pytest.skip("not installed: ninja")
    ninja = ("ninja", "-C", build, "-t")
    targets = ("unlidar_track", "unlidar_python")
    inputs = output_of(*ninja, "inputs", *targets).splitlines()
    objects = [line for line in inputs if line.endswith(".o")]
    noted = output_of(*ninja, "deps", *objects).splitlines()
    # A path in a line, where it is one, from the build folder on or from the root on.
    used = {Path(os.path.normpath(build / line.strip())) for line in (*inputs, *noted)}
    mine = {str(path.relative_to(PROJECT)) for path in used if path.is_relative_to(PROJECT)}
    wanted = {name for name in mine if name.startswith(("src/", "include/", "cmake/", "configs/"))}
    assert len(wanted) > 200
    assert wanted - files_below(sources) == set()


def test_pip_makes_of_the_sources_the_files_of_the_wheel(
    packages: Packages, sources: Path, tmp_path: Path
) -> None:
    """With what CMake has built in build/, of the same files."""
    output_of(
        sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", "--no-deps",
        "--no-build-isolation", "--wheel-dir", tmp_path, packages.sources,
        env=os.environ | {"UNLIDAR_BUILD_DIR": str(PROJECT / "build")},
    )  # fmt: skip
    (made,) = tmp_path.glob(f"unlidar_track-{packages.version}-*.whl")
    with zipfile.ZipFile(made) as archive, zipfile.ZipFile(packages.wheel) as whole:
        files, all_files = {*archive.namelist()}, {*whole.namelist()}
    assert {name for name in files if ".dist-info/" not in name} == {
        name
        for name in all_files
        if not name.endswith("/") and not re.search(r"\.(dist-info|libs)/", name)
    }


def test_pip_compiles_the_sources(packages: Packages, tmp_path: Path) -> None:
    """From nothing, as on a Debian 12 with the packages of tools/setup.sh; minutes."""
    if "UNLIDAR_COMPILE_SOURCES" not in os.environ:
        pytest.skip("UNLIDAR_COMPILE_SOURCES is not set: it takes minutes")
    venv = tmp_path / "venv"
    output_of("/usr/bin/python3", "-m", "venv", venv)
    path = {"PATH": f"{venv / 'bin'}:/usr/bin:/bin"}
    output_of(venv / "bin/pip", "install", packages.sources, env=os.environ | path)
    environment = {"HOME": str(tmp_path)} | path
    output_of("unlidar", "simulate", "demo", "flight", cwd=tmp_path, env=environment)
    output_of("unlidar", "run", "flight", "--out", "out", cwd=tmp_path, env=environment)
    asked = "import unlidar; print(len(unlidar.track(unlidar.read('flight'))))"
    assert output_of("python", "-c", asked, cwd=tmp_path, env=environment) == "1\n"


def test_the_wheel_tracks_by_its_own_program_and_by_its_engine(unlidar: Path, sky: Path) -> None:
    tracked = run_unlidar(unlidar, sky, "run", "flight", "--out", "out")
    assert tracked.returncode == 0, tracked.stderr
    (trajectory,) = (sky / "out").rglob("traj.csv")
    asked = (
        "import unlidar\n"
        "(track,) = unlidar.track(unlidar.read('flight'))\n"
        "print(unlidar._engine.__file__, len(track.rows), f'{track.rows[-1][\"x\"]:.6f}')"
    )
    told = output_of(unlidar.with_name("python"), "-c", asked, cwd=sky, env={"PATH": "/usr/bin"})
    module, rows, x = told.split()
    assert Path(module).is_relative_to(unlidar.parents[1])
    lines = trajectory.read_text().splitlines()
    assert (int(rows), x) == (len(lines) - 1, lines[-1].split(",")[2])


def test_the_wheel_runs_the_program_that_is_named(
    unlidar: Path, sky: Path, installed: Path
) -> None:
    named = installed / "usr/bin/unlidar_track"
    asked = "from unlidar.program import find_program; print(find_program())"
    python = unlidar.with_name("python")
    found = output_of(python, "-c", asked, cwd=sky, env={"UNLIDAR_TRACK": str(named)})
    assert Path(found.strip()) == named
