"""The shell scripts: what they say when they cannot go on, and that a second run does nothing.

They run in a copy of the project's tools with stand-ins for apt, CMake and Python, so that nothing
is installed or built here.
"""

from __future__ import annotations

import re
import shutil
import stat
import subprocess
from pathlib import Path

import pytest
from synthetic import PROJECT, run_program

# What the scripts may use of the system; everything else comes from the stand-ins.
SYSTEM = ["basename", "bash", "cat", "chmod", "cp", "cut", "dirname", "env", "grep", "mkdir", "sh"]
SYSTEM += ["nproc", "realpath", "rm", "sed", "sha256sum", "sort", "stat", "tail", "tee", "touch"]
SYSTEM += ["tr", "true", "xargs"]

# Pretends that every package is there.
ALL_INSTALLED = 'shift 2; for p in "$@"; do echo "$p installed"; done'
# Pretends to be a Python of which -m venv makes a copy.
PYTHON = """
case "$*" in
  --version) echo "Python of $0" ;;
  *'-m venv'*) for last; do :; done; mkdir -p "$last/bin"
    cp "$0" "$last/bin/python"; cp "$HERE/unlidar" "$last/bin/unlidar"
    echo "${0##*/} makes $last" >>"$HERE/venvs" ;;
  *'-m pip'*) echo pip >>"$HERE/calls"; echo "$*" >>"$HERE/pips" ;;
esac
"""


class Sandbox:
    """A project folder with blanks in its name and a PATH of its own."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "the project"
        self.bin = folder / "bin"
        self.bin.mkdir()
        shutil.copytree(PROJECT / "tools", self.root / "tools")
        shutil.copy(PROJECT / "pyproject.toml", self.root)
        fuzzers = self.root / "src" / "fuzz"
        fuzzers.mkdir(parents=True)
        for target in ("one", "two"):
            (fuzzers / f"{target}_fuzz.cpp").touch()
        setup = self.root / "tools" / "setup.sh"
        text = setup.read_text()
        assert text.count("/usr/bin/python3") == 1
        setup.write_text(text.replace("/usr/bin/python3", f"'{self.bin}/debian-python3'"))
        for name in SYSTEM:
            found = shutil.which(name)
            assert found, f"{name} is missing on this system"
            (self.bin / name).symlink_to(found)
        self.put("dpkg-query", ALL_INSTALLED)
        self.put(
            "apt-get", 'echo apt-get >>"$HERE/calls"; echo "cannot reach the mirror"; exit 100'
        )
        self.put("cmake", 'echo cmake >>"$HERE/calls"')
        self.put("python3", PYTHON)
        self.put("unlidar", 'echo "unlidar $*"')

    def put(self, name: str, body: str) -> None:
        path = self.bin / name
        path.unlink(missing_ok=True)
        path.write_text(f"#!{shutil.which('bash')}\nHERE='{self.bin}'\n{body}\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)

    def calls(self) -> list[str]:
        path = self.bin / "calls"
        made = path.read_text().split() if path.exists() else []
        path.unlink(missing_ok=True)
        return made

    def run(self, script: str, *arguments: str, cwd: Path | None = None):
        return subprocess.run(
            [self.root / "tools" / script, *arguments],
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            cwd=cwd or self.bin,
            env={"PATH": str(self.bin)},
            timeout=60,
        )


@pytest.fixture
def sandbox(tmp_path: Path) -> Sandbox:
    return Sandbox(tmp_path)


@pytest.mark.parametrize(
    "script",
    ["demo.sh", "test.sh", "package.sh", "fuzz.sh", "bench.sh", "arm64.sh", "lock.sh",
     "wheel_dependencies.sh"],
)  # fmt: skip
def test_help_is_shown_without_doing_anything(sandbox: Sandbox, script: str) -> None:
    shown = sandbox.run(script, "--help")
    assert shown.returncode == 0 and f"Usage: tools/{script}" in shown.stdout
    assert sandbox.calls() == []


@pytest.mark.parametrize(
    ("script", "arguments", "reason"),
    [
        ("demo.sh", ["no/such/recording"], "no such recording: 'no/such/recording'"),
        ("demo.sh", ["a", "b"], "at most one recording"),
        ("demo.sh", ["--fast"], "unknown option '--fast'"),
        ("test.sh", ["more"], "unexpected argument 'more'"),
        ("test.sh", ["--quick", "--sanitize"], "expected one option, got 2"),
        ("package.sh", ["--fast"], "unexpected argument '--fast'"),
        ("lock.sh", ["--fast"], "unexpected argument '--fast'"),
        ("package.sh", ["--arm64", "more"], "expected one option, got 2"),
        ("wheel_dependencies.sh", [], "Usage: tools/wheel_dependencies.sh FOLDER"),
        ("arm64.sh", ["--slow"], "unexpected argument '--slow'"),
        ("arm64.sh", ["--quick", "more"], "expected one option, got 2"),
        ("bench.sh", ["--slow"], "unknown option '--slow'"),
        ("bench.sh", ["speed"], "no part 'speed', expected some of: clustering pcd"),
        ("fuzz.sh", [], "expected a number of minutes"),
        ("fuzz.sh", ["0"], "'0': expected a whole number of minutes above 0"),
        ("fuzz.sh", ["0s"], "'0s': expected a whole number of minutes above 0"),
        ("fuzz.sh", ["--runs", "many", "1"], "--runs 'many': expected a whole number above 0"),
        ("fuzz.sh", ["--runs"], "--runs: expected a number of executions behind it"),
        ("fuzz.sh", ["1", "nothing"], "no target 'nothing', expected some of: one two"),
    ],
)
def test_wrong_arguments_are_refused_before_anything_is_installed(
    sandbox: Sandbox, script: str, arguments: list[str], reason: str
) -> None:
    refused = sandbox.run(script, *arguments)
    assert refused.returncode != 0 and reason in refused.stderr
    assert sandbox.calls() == []


def test_the_demo_runs_twice_and_installs_once(sandbox: Sandbox) -> None:
    first = sandbox.run("demo.sh")
    assert first.returncode == 0, first.stderr
    assert sandbox.calls() == ["cmake", "cmake", "pip", "pip"]
    assert "unlidar " in first.stdout
    again = sandbox.run("demo.sh")
    assert again.returncode == 0, again.stderr
    assert sandbox.calls() == ["cmake", "cmake"]


def test_pip_takes_the_wheels_of_the_lock_and_nothing_else(sandbox: Sandbox) -> None:
    sandbox.run("demo.sh")
    locked, own = (sandbox.bin / "pips").read_text().splitlines()
    for option in ("--no-deps", "--require-hashes", "--only-binary :all:"):
        assert f" {option} " in locked
    assert locked.endswith(f"--requirement {sandbox.root}/tools/requirements.txt")
    assert "--no-deps --no-build-isolation --editable" in own


def test_changed_requirements_or_a_moved_folder_are_installed_anew(sandbox: Sandbox) -> None:
    sandbox.run("demo.sh")
    sandbox.calls()
    for name in ("pyproject.toml", "tools/requirements.txt"):
        with (sandbox.root / name).open("a") as file:
            file.write("# changed\n")
        sandbox.run("demo.sh")
        assert "pip" in sandbox.calls()
    sandbox.root = sandbox.root.rename(sandbox.root.with_name("elsewhere"))
    sandbox.run("demo.sh")
    assert "pip" in sandbox.calls()


def test_a_recording_is_found_relative_to_the_callers_folder(
    sandbox: Sandbox, tmp_path: Path
) -> None:
    recording = tmp_path / "my recordings" / "flight 1"
    recording.mkdir(parents=True)
    shown = sandbox.run("demo.sh", "flight 1", cwd=recording.parent)
    assert shown.returncode == 0, shown.stderr
    assert str(recording) in shown.stdout


def test_without_apt_the_reason_names_the_packages(sandbox: Sandbox) -> None:
    (sandbox.bin / "apt-get").unlink()
    refused = sandbox.run("demo.sh")
    assert refused.returncode != 0
    assert "not Debian or Ubuntu" in refused.stderr and "libpcl-dev" in refused.stderr


def test_a_failing_apt_is_shown_with_the_missing_package(sandbox: Sandbox) -> None:
    sandbox.put("dpkg-query", ALL_INSTALLED.replace("echo", '[ "$p" = libceres-dev ] || echo'))
    sandbox.put("sudo", 'case $1 in -*) ;; *) exec "$@" ;; esac')
    refused = sandbox.run("demo.sh")
    assert refused.returncode != 0
    reason = refused.stderr.strip().splitlines()[-1]
    assert "apt-get could not install libceres-dev; is there a network?" in reason
    assert "cannot reach the mirror" in refused.stderr
    assert set(sandbox.calls()) == {"apt-get"}


# apt-get as it speaks: scripts of packages find the descriptor of its status closed, and fail where
# that leaves them without an output, as libxml-sax-perl's does.
APT = """
case $* in *install*) ;; *) exit 0 ;; esac
all="$*"; fd=${all#*Status-Fd=}; fd=${fd%% *}
echo "Reading package lists..."
echo "0 upgraded, 217 newly installed, 0 to remove and 0 not upgraded."
echo "Need to get 412 MB of archives."
echo "dlstatus:1:3.1:Retrieving file 1 of 217" >&$fd
echo "dlstatus:99:57.8:Retrieving file 99 of 217" >&$fd
for i in 12.0 15.5 100.0; do echo "pmstatus:libfoo:$i:Unpacking libfoo (amd64)" >&$fd; done
(eval "exec $fd>&-"; echo "Setting up libfoo") || exit 100
"""


def test_what_apt_does_is_reported_while_it_does_it(sandbox: Sandbox) -> None:
    sandbox.put("dpkg-query", ALL_INSTALLED.replace("echo", '[ "$p" = libceres-dev ] || echo'))
    sandbox.put("sudo", 'case $1 in -*) ;; *) exec "$@" ;; esac')
    sandbox.put("apt-get", APT)
    shown = sandbox.run("demo.sh")
    assert shown.returncode == 0, shown.stderr
    told = shown.stdout.partition("Installing libceres-dev")[2].partition("\n==>")[0]
    assert [line.strip() for line in told.splitlines()[1:] if line.strip()] == [
        "0 upgraded, 217 newly installed, 0 to remove and 0 not upgraded.",
        "Need to get 412 MB of archives.",
        "downloaded: 0 %",
        "downloaded: 50 %",
        "installed: 10 %",
        "installed: 100 %",
    ]


# Pretends to be CMake, which builds two copies of a fuzzer.
FUZZ_BUILD = """
case "$*" in *--build*) mkdir -p "$2/src/fuzz"
  for t in one two; do cp "$HERE/a_fuzz" "$2/src/fuzz/${t}_fuzz"; done ;;
esac
"""
FUZZER = """
echo "$*" >>"$0.calls"; echo "stat::number_of_executed_units: 7"
case $0 in *two_fuzz) echo "BROKEN LAW: one and one is two"; exit 77 ;; esac
"""


def test_a_find_of_a_fuzzer_is_shown_and_fails(sandbox: Sandbox) -> None:
    sandbox.put("cmake", FUZZ_BUILD)
    sandbox.put("a_fuzz", FUZZER)
    found = sandbox.run("fuzz.sh", "--runs", "9", "2")
    assert found.returncode != 0 and "something was found" in found.stderr
    assert "one: 7 executions, no find" in found.stdout
    assert "BROKEN LAW: one and one is two" in found.stdout
    assert "two: 7 executions, A FIND" in found.stdout
    calls = (sandbox.root / "build-sanitize" / "src" / "fuzz" / "one_fuzz.calls").read_text()
    assert "-max_total_time=120" in calls and "-runs=9" in calls
    good = sandbox.run("fuzz.sh", "1", "one")
    assert good.returncode == 0, good.stderr


def test_an_old_python_is_named(sandbox: Sandbox) -> None:
    sandbox.put("python3", 'case "$*" in --version) echo Python 3.9.2 ;; *) exit 1 ;; esac')
    refused = sandbox.run("demo.sh")
    assert refused.returncode != 0
    assert "Python 3.11 or newer with venv is needed, found Python 3.9.2" in refused.stderr


def test_the_systems_python_goes_before_a_newer_one_in_the_path(sandbox: Sandbox) -> None:
    sandbox.run("demo.sh")
    sandbox.put("debian-python3", PYTHON)
    sandbox.run("demo.sh")
    sandbox.run("demo.sh")
    made = (sandbox.bin / "venvs").read_text().splitlines()
    # The environment of the other Python is made anew, once.
    assert [line.split()[0] for line in made] == ["python3", "debian-python3"]


def test_a_failing_build_ends_with_the_reason(sandbox: Sandbox) -> None:
    sandbox.put("cmake", 'echo "no CMAKE_CXX_COMPILER could be found"; exit 1')
    refused = sandbox.run("demo.sh")
    assert refused.returncode != 0
    assert "no CMAKE_CXX_COMPILER could be found" in refused.stderr
    assert "CMake could not configure the build" in refused.stderr.splitlines()[-1]


def test_ci_runs_the_test_script_from_any_folder(tmp_path: Path) -> None:
    (tmp_path / ".ci").mkdir()
    (tmp_path / "tools").mkdir()
    shutil.copy(PROJECT / ".ci" / "run", tmp_path / ".ci" / "run")
    (tmp_path / "tools" / "test.sh").write_text("#!/usr/bin/env bash\necho tested; exit 7\n")
    (tmp_path / "tools" / "test.sh").chmod(0o755)
    ran = subprocess.run(
        ["bash", tmp_path / ".ci" / "run"], capture_output=True, text=True, cwd="/"
    )
    assert (ran.returncode, ran.stdout) == (7, "tested\n")


def test_the_reference_speaks_of_options_and_columns_that_exist() -> None:
    text = (PROJECT / "docs/reference.md").read_text()
    shown = run_program("--help").stdout
    table = text.split("| option | meaning |")[1].split("\n\n")[0]
    named = set(re.findall(r"--[a-z]+", table))
    assert len(named) >= 15
    assert [option for option in named if option not in shown] == []
    header = (PROJECT / "python_tests" / "synthetic.py").read_text().split('TRAJ_HEADER = "')[1]
    columns = header.split('"')[0].split(",")
    assert [c for c in columns if not re.search(rf"[`,]{c}[`,]", text)] == []


def anchors(page: Path) -> set[str]:
    """Of the headings of a page, as they are linked to."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.strip()).lower().replace(" ", "-") for h in headings}


def test_every_page_is_reached_from_the_index_and_every_link_leads_on() -> None:
    reached, waiting = set(), [PROJECT / "docs/README.md"]
    while waiting:
        page = waiting.pop()
        if page in reached:
            continue
        reached.add(page)
        for link in re.findall(r"\[[^\]]*\]\(([^)\s]+)\)", page.read_text()):
            if link.startswith("http"):
                continue
            place, _, anchor = link.partition("#")
            target = (page.parent / place).resolve() if place else page
            assert target.exists(), f"{page.name}: {link}"
            if target.suffix == ".md":
                assert not anchor or anchor in anchors(target), f"{page.name}: {link}"
                waiting.append(target)
    assert set((PROJECT / "docs").rglob("*.md")) <= reached


def test_the_readme_is_short() -> None:
    assert len((PROJECT / "README.md").read_text().split()) <= 1000
    assert len((PROJECT / "docs/method.md").read_text().split()) <= 5000


def test_settings_in_the_documents_are_keys_of_the_configuration() -> None:
    # --set of a key that does not exist ends with exit code 3 before any frame is read.
    sections = ("input", "robust", "trajectory", "paper")
    pattern = re.compile(rf"`((?:{'|'.join(sections)})\.[a-z_.]+)`")
    for document in [PROJECT / "README.md", *(PROJECT / "docs").glob("*.md")]:
        for key in set(pattern.findall(document.read_text())):
            said = run_program("--frames", "absent", "--out", "x", "--set", f"{key}=").stderr
            assert "unknown key" not in said, f"{document.name}: {said}"


def test_the_citation_names_the_version_of_the_program() -> None:
    version = run_program("--version").stdout.split()[1]
    assert f"\nversion: {version}\n" in (PROJECT / "CITATION.cff").read_text()
