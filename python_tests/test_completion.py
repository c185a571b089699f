"""The scripts of `unlidar completion`, in the shells they are for."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from unlidar.cli import main
from unlidar.cli.completion import SHELLS


@pytest.fixture(params=SHELLS)
def script(request, capsys, tmp_path) -> tuple[str, Path]:
    assert main(["completion", request.param]) == 0
    path = tmp_path / f"unlidar.{request.param}"
    path.write_text(capsys.readouterr().out)
    return request.param, path


def commands(capsys) -> list[str]:
    assert main(["--help"]) == 0
    return re.findall(r"^    ([a-z]+)(?: |$)", capsys.readouterr().out, re.MULTILINE)


def test_every_command_and_every_option_is_known(script, capsys) -> None:
    _, path = script
    text = path.read_text()
    listed = commands(capsys)
    assert "completion" in listed
    for command in listed:
        assert main([command, "--help"]) == 0
        shown = capsys.readouterr().out.split("example:")[0]
        options = re.findall(r"^  (?:-\w, )?--([a-z][a-z-]+)", shown, re.MULTILINE)
        assert "help" in options
        assert command in text
        assert [option for option in options if option not in text] == []


def test_the_shell_takes_the_script(script) -> None:
    shell, path = script
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    done = subprocess.run([shell, "-n", str(path)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def proposals(path: Path, *words: str) -> set[str]:
    """The completions that bash proposes for the last word."""
    assign = f"COMP_WORDS=(unlidar {shlex.join(words)}); COMP_CWORD={len(words)}"
    function = "$(complete -p unlidar | sed 's/.*-F \\([^ ]*\\).*/\\1/')"
    last, before = shlex.quote(words[-1]), shlex.quote(["unlidar", *words][-2])
    line = f"source {shlex.quote(str(path))}; {assign}; {function} unlidar {last} {before}; "
    line += 'printf "%s\\n" "${COMPREPLY[@]}"'
    done = subprocess.run(
        ["bash", "-c", line], capture_output=True, text=True, cwd=path.parent, check=True
    )
    return set(done.stdout.split())


def test_bash_proposes_commands_options_choices_and_files(capsys, tmp_path) -> None:
    assert main(["completion", "bash"]) == 0
    path = tmp_path / "unlidar.bash"
    path.write_text(capsys.readouterr().out)
    (tmp_path / "recording.bag").touch()
    assert proposals(path, "") >= set(commands(capsys))
    assert proposals(path, "ev") == {"evaluate"}
    assert "--markdown" in proposals(path, "evaluate", "--m")
    assert proposals(path, "evaluate", "--align", "y") == {"yaw"}
    assert "recording.bag" in proposals(path, "run", "rec")
    assert "recording.bag" in proposals(path, "run", "x", "--config", "rec")
