"""Addresses that hold secrets, and mistakes."""

from __future__ import annotations

import pytest


@pytest.mark.parametrize(
    ("code", "arguments"),
    [
        (2, ["relay", "-", "--to", "mqtt://user:hush@h:99999"]),
        (2, ["relay", "-", "--to", "mqtt://user:hush"]),
        (2, ["relay", "-", "--to", "mqtt://user:a/hush?@b#c@h/x"]),
        (2, ["relay", "-", "--to", "cot+tcp://user:hush@h:1"]),
        (2, ["relay", "-", "--to", "ws://127.0.0.1:70000/?token=hush@hush"]),
        (2, ["relay", "-", "--to", "ws://127.0.0.1:7/hush"]),
        (2, ["relay", "-", "mqtt://user:hush@h:99999"]),  # --to may be left out
        (2, ["relay", "mqtt://user:hush@h", "--to", "mqtt://h"]),
        (2, ["relay", "tcp://user:hush@h:1/x", "--to", "mqtt://h"]),
        (4, ["relay", "nowhere/user:hush@h:1", "--to", "mqtt://h"]),
        (2, ["watch", "mqtt://user:hush@h/x"]),
    ],
)
def test_an_address_with_a_mistake_is_shown_without_its_secrets(code, arguments, fails) -> None:
    assert "hush" not in fails(code, *arguments)


def test_a_site_with_a_mistake_is_shown_without_its_secrets(tmp_path, fails) -> None:
    path = tmp_path / "site.yaml"
    for outputs in ("- {to: 'mqtt://user:hush@h:x'}", "- mqtt://user:hush@h", "mqtt://u:hush@h"):
        path.write_text(f"outputs:\n{outputs}\n")
        fails_with = 2 if "to:" in outputs else 3
        assert "hush" not in fails(fails_with, "relay", "-", "--site", path)
