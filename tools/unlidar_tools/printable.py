"""Text from outside (names in recordings, paths, messages of libraries), made fit to be printed.

Whoever wrote a recording chose its names. They must not move the cursor, break a table's lines or
be taken for markup.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.text import Text


def printable(text: object) -> str:
    r"""One line of `text` for any terminal or log.

    What is no visible character (control codes, line breaks, marks that turn the direction of
    writing, bytes that are no text) stands as an escape like \x1b or \u202e.
    """
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in str(text)
    )


def cell(text: object) -> "Text":
    """`printable(text)` for rich: a cell or a title, in which [x] and :x: stand for themselves."""
    # Here, so that error messages need not wait for rich.
    from rich.text import Text

    return Text(printable(text))
