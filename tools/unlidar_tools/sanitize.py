"""Text from outside (names in recordings, paths, messages of libraries), made fit to be printed.

Whoever wrote a recording chose its names. They must not move the cursor, break a table's lines or
be taken for markup.
"""

import re
import unicodedata
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


# Letters by Unicode that nobody sees.
_BLANK = re.compile("[\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0]")


def is_visible(text: str) -> bool:
    """Whether a name can be seen and told from another: no blanks alone, no invisible letters."""
    if not text.isprintable() or _BLANK.search(text):
        return False
    return any(unicodedata.category(c)[0] not in "MZ" for c in text)


def cell(text: object) -> "Text":
    """`printable(text)` for rich: a cell or a title, in which [x] and :x: stand for themselves."""
    # Here, so that error messages need not wait for rich.
    from rich.text import Text

    return Text(printable(text))


# A password may hold anything: all up to the last @ goes, and the host too where it may be a part
# of a query. Behind a colon that no port follows may be a password whose host was forgotten.
_URL = re.compile(
    r"""(?<![A-Za-z0-9+.-])(?P<scheme>[A-Za-z][A-Za-z0-9+.-]*://)(?P<user>.*@)?
    (?P<host>\[[^\]\s]*\]|[^\s/?\#:'"@]*)
    (?P<port>:(?:\d{1,5}|PORT)(?=[/?\#:,;.)\]'"\s]|$))?
    (?P<rest>[^\s'"]*)
    |[^\s'":@]{0,1024}:[^\s'"@]{1,1024}@""",  # a login without a scheme
    re.DOTALL | re.VERBOSE,
)
_EXPECTED = "[USER:PASSWORD@]"  # where a message tells of what may be there
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
