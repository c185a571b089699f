"""docs/formats.md names tests that exist, and every option of `unlidar convert`."""

import re
import shlex
from pathlib import Path

from unlidar.cli import main

TESTS = Path(__file__).parent
PAGE = (TESTS.parent / "docs/formats.md").read_text()


def test_every_test_that_the_list_of_formats_names_exists():
    defined = set(
        re.findall(r"^def (test_\w+)", "".join(map(Path.read_text, TESTS.glob("*.py"))), re.M)
    )
    for name, is_begin in re.findall(r"`(test_\w+?)(\.\.\.)?(?:\[[\w .-]*\])?`", PAGE):
        found = [test for test in defined if test == name or (is_begin and test.startswith(name))]
        assert found, name
    for file in re.findall(r"`(test_\w+\.py)`", PAGE):
        assert (TESTS / file).is_file(), file


def test_every_option_is_on_the_page_with_an_example_that_the_parser_takes(capsys):
    assert main(["convert", "--help"]) == 0
    shown = re.findall(r"--[a-z-]+[a-z]", capsys.readouterr().out)
    options = set(shown) - {"--help", "--verbose"}  # which every command has
    assert options <= set(re.findall(r"`(--[a-z-]+)", PAGE))
    examples = re.findall(r"`(unlidar convert [^`]*)`", PAGE)
    assert len(examples) >= len(options) - 1  # --start and --duration share one
    for example in examples:
        # The recordings are not there: past the parser, that is what is said.
        assert main(shlex.split(example)[1:]) == 4, example
        assert "does not exist" in capsys.readouterr().err
