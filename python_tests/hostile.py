"""Names that would run a script where a page takes them for more than text."""

from __future__ import annotations

# Each sets `pwned`, or leaves an element with the attribute `evil`.
HOSTILE = (
    "\"'><img src=x onerror=pwned=1 evil>",
    "</script><script>pwned=1</script>",
    "<svg evil onload=pwned=1>",
    "<a evil href='javascript:pwned=1'>x</a>",
    "${pwned=1}`;pwned=1//",
    "--><iframe evil srcdoc='<script>parent.pwned=1</script>'></iframe>",
    "\u2028\u2029';pwned=1;'",
    "__proto__",
)
ALL = "".join(HOSTILE)


def broken_out(page) -> list[str]:
    """Signs that a page interpreted a name as markup or script; empty if all is well."""
    found = [f"said: {line}" for line in complaints(page)]
    if page.run("return typeof pwned != 'undefined'"):
        found.append("a script has run")
    count = page.run(
        "return document.querySelectorAll('[evil], iframe, embed, object, [href^=\"javascript\"]')"
        ".length"
    )
    return found + ["an element was put in"] * count


def complaints(page) -> list[str]:
    """Errors and violations of the policy, as the browser's console has them."""
    return [
        entry["message"]
        for entry in page.log("browser")
        if entry["level"] == "SEVERE" or "Content Security Policy" in entry["message"]
    ]
