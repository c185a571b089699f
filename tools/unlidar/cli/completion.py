"""`unlidar completion`: completion scripts for shells."""

import argparse
from pathlib import Path

SHELLS = ("bash", "zsh", "fish")
EXAMPLE = """unlidar completion bash > unlidar.bash

install it for yourself, then open a new shell:
  bash  into ~/.local/share/bash-completion/completions/unlidar (package bash-completion)
  zsh   into a folder of $fpath as _unlidar, for instance /usr/local/share/zsh/site-functions
  fish  into ~/.config/fish/completions/unlidar.fish"""


def define(p: argparse.ArgumentParser, command: argparse.ArgumentParser) -> None:
    """Adds the argument; `command` is the parser of all sub-commands."""
    p.add_argument("shell", choices=SHELLS, help="print the script for this shell")
    p.set_defaults(act=lambda a: _print(a.shell, command))


def _print(shell: str, command: argparse.ArgumentParser) -> None:
    import shtab

    _complete_paths(command)
    print(shtab.complete(command, shell))


def _complete_paths(parser: argparse.ArgumentParser) -> None:
    """Marks path arguments, for which the shell proposes files and folders."""
    import shtab

    for action in parser._actions:  # argparse has no other way to list them
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                _complete_paths(child)
        elif action.type is Path or action.dest in ("sources", "scenario", "group"):
            action.complete = shtab.FILE
