"""The help of every command shows examples that work, with a stand-in for the program."""

import re
import shlex
import shutil
from pathlib import Path

import pytest
from many import StandIn
from unlidar.cli import main
from unlidar.configs import scenario_names

# In an order in which one makes what the next one reads.
CHEAP = ("convert", "simulate", "run", "evaluate", "export", "report")


def examples(capsys, *command: str) -> list[list[str]]:
    assert main([*command, "--help"]) == 0
    shown = re.split(r"example:\s+", capsys.readouterr().out)[1]
    parts = [part for line in shown.splitlines() for part in line.split(" && ")]
    return [shlex.split(part) for part in parts if part.strip()]


def test_every_help_shows_examples_of_its_command(capsys) -> None:
    assert main(["--help"]) == 0
    listed = re.findall(r"^    ([a-z]+)(?: |$)", capsys.readouterr().out, re.MULTILINE)
    assert set(CHEAP) <= set(listed)
    for command in listed:
        shown = examples(capsys, command)
        assert any(words[:2] == ["unlidar", command] for words in shown), command


@pytest.mark.parametrize("words", [("run", "a"), ("evaluate", "a", "b"), ("simulate", "a", "b")])
def test_options_that_a_command_does_not_know_name_its_help(words: tuple[str, ...], fails) -> None:
    said = fails(2, *words, "--no-such")
    assert f"unrecognized arguments: --no-such (see unlidar {words[0]} --help)" in said


def test_the_help_of_simulate_names_every_scenario(capsys) -> None:
    assert main(["simulate", "--help"]) == 0
    words = set(re.findall(r"\w+", capsys.readouterr().out))
    assert {"demo", "empty_sky", "visitor"} <= set(scenario_names()) <= words


def test_the_examples_of_help_work_one_after_another(tmp_path, monkeypatch, capsys, shared) -> None:
    monkeypatch.setenv("UNLIDAR_TRACK", str(StandIn(tmp_path).write()))
    monkeypatch.chdir(tmp_path)
    Path("mmaud").symlink_to(shared / "data/mmaud")
    for command in CHEAP:
        for words in examples(capsys, command):
            if words[1] == "simulate" and Path(words[3]).exists():
                words.append("--force")
            assert main(words[1:]) == 0, shlex.join(words)
        if command == "run":  # what the examples of the later commands call their own
            assert main(["run", "mmaud/val/seq0001"]) == 0
            for name in ("seq1", "seq2", "day/seq1", "night/seq2"):
                shutil.copytree("out/run/seq0001", Path("out/run") / name)
            Path("stamps.csv").write_text(
                "Sequence,Timestamp\nseq1,1706255622.0\nseq2,1706255622.0\n"
            )
