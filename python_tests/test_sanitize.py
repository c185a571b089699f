"""Text from outside reaches the terminal as one line of visible characters, and as it is."""

import io

import pytest
from rich.console import Console
from rich.table import Table
from unlidar.sanitize import cell, hide_secrets, printable

NASTY = ("\x1b[31mred\x1b[0m", "two\nlines", "a\rb", "tab\there", "\x00", "\x9b2J", "\u202egnp",
         "\u2028", "\udc80", "\x07", "\ufeff")  # fmt: skip
PLAIN = (
    "",
    "[x]",
    "[/]",
    "[red]name[/red]",
    "a\\",
    "\\[x]",
    ":warning:",
    "a b",
    "über-Größe",
    "点群",
)


@pytest.mark.parametrize("text", NASTY)
def test_what_a_terminal_would_act_on_is_an_escape(text):
    shown = printable(text)
    assert shown.isprintable()
    assert shown.encode("utf-8").decode() == shown
    assert shown.encode().decode("unicode_escape", "surrogatepass") == text


@pytest.mark.parametrize("text", PLAIN)
def test_what_is_visible_stays_as_it_is(text):
    assert printable(text) == text


@pytest.mark.parametrize("text", (*NASTY, *PLAIN))
def test_a_cell_of_a_table_shows_the_text_itself_on_one_line(text):
    table = Table("name", "end")
    table.add_row(cell(text), "|end|")
    file = io.StringIO()
    Console(file=file, width=200).print(table)
    lines = [line for line in file.getvalue().splitlines() if "end" in line]
    assert [printable(text) in line for line in lines] == [not text, True]
    assert len(file.getvalue().split("\n")) == 6


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("'mqtt://me:hush@h:1', expected HOST", "'mqtt://...@h:1', expected HOST"),
        ("mqtt://me:a/hush?b@h", "mqtt://..."),
        ("mqtt://me:hush", "mqtt://me:..."),
        ("ws://h:1/?token=hush: no", "ws://h:1/... no"),
        ("ws://h:1/?token=hush@hush", "ws://..."),
        ("me:hush@h:1: is no file", "...@h:1: is no file"),
        ("arguments: mqtt://me:hush hush@h", "arguments: mqtt://...@h"),
        ("mqtt://h:1883: refused", "mqtt://h:1883: refused"),
        ("tcp://HOST:PORT or mqtts://[USER:PASSWORD@]HOST", "the same"),
        ("cot+udp://[::1]:6969: 'x' (ws://h:1), http://127.0.0.1:8377/", "the same"),
        ("/data/me@home/events.jsonl: is a folder", "the same"),
    ],
)
def test_addresses_are_shown_without_their_secrets(said: str, shown: str) -> None:
    hidden = hide_secrets(said)
    assert hidden == (said if shown == "the same" else shown)
    assert hide_secrets(hidden) == hidden
