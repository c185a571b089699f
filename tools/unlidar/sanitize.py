"""Sanitising of untrusted text (names in recordings, paths, messages of libraries) for output.

Names in recordings are chosen by their writer. They must not move the cursor, break table rows or
act as markup.
"""

import re
import unicodedata
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.text import Text


def printable(text: object) -> str:
    r"""One line of `text` for any terminal or log.

    Characters that are not printable (control codes, line breaks, bidirectional marks, surrogate
    bytes) become escapes like \x1b or \u202e.
    """
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in str(text)
    )


# Blank characters that Unicode classifies as letters or symbols.
_BLANK = re.compile("[\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0]")


def is_visible(text: str) -> bool:
    """True if a name is visible and distinguishable: not only blanks, no invisible letters."""
    if not text.isprintable() or _BLANK.search(text):
        return False
    return any(unicodedata.category(c)[0] not in "MZ" for c in text)


def cell(text: object) -> "Text":
    """`printable(text)` as rich Text, in which [x] and :x: are literal."""
    # Imported here, so that error messages need not load rich.
    from rich.text import Text

    return Text(printable(text))


# Passwords may hold any character: all up to the last @ is hidden, and the host too if it may be
# part of a query. A colon without a port may precede a password whose host was forgotten.
_URL = re.compile(
    r"""(?<![A-Za-z0-9+.-])(?P<scheme>[A-Za-z][A-Za-z0-9+.-]*://)(?P<user>.*@)?
    (?P<host>\[[^\]\s]*\]|[^\s/?\#:'"@]*)
    (?P<port>:(?:\d{1,5}|PORT)(?=[/?\#:,;.)\]'"\s]|$))?
    (?P<rest>[^\s'"]*)
    |[^\s'":@]{0,1024}:[^\s'"@]{1,1024}@""",  # a login without a scheme
    re.DOTALL | re.VERBOSE,
)
_EXPECTED = "[USER:PASSWORD@]"  # placeholder in expectations, kept
_HARMLESS = re.compile(r"/?[:,;.)\]]*")


def hide_secrets(text: str) -> str:
    """The text with `...` for users, passwords, paths and queries of the addresses in it."""
    if "://" not in text and "@" not in text:
        return text
    return _EXPECTED.join(_URL.sub(_hidden, part) for part in text.split(_EXPECTED))


def _hidden(url: re.Match[str]) -> str:
    user, rest = url["user"] or "", url["rest"]
    if url["scheme"] is None:
        return "...@"
    if re.search("[/?#]", user):
        return f"{url['scheme']}..."
    if not _HARMLESS.fullmatch(rest):
        rest = f"{rest[0]}..." if rest[0] in ":/?#" else "..."
    return f"{url['scheme']}{'...@' if user else ''}{url['host']}{url['port'] or ''}{rest}"
