"""Choice between header stamp and log time of messages, with statistics of their difference."""

from dataclasses import dataclass
from typing import Literal

# Smaller differences are transport delay; larger ones mean different clocks.
_NOTABLE_NS = 1_000_000_000


@dataclass
class StampSelector:
    """Selects the stamps of one topic."""

    choice: Literal["header", "log"]
    messages: int = 0
    unset: int = 0  # headers without a stamp
    least_ns: int = 0  # of log time - header stamp
    most_ns: int = 0

    def pick(self, header_ns: int, log_ns: int) -> int:
        """The frame's stamp in ns; the log time if the header has none."""
        self.messages += 1
        if header_ns == 0:
            self.unset += 1
            return log_ns
        apart_ns = log_ns - header_ns
        first = self.messages - self.unset == 1
        self.least_ns = apart_ns if first else min(self.least_ns, apart_ns)
        self.most_ns = apart_ns if first else max(self.most_ns, apart_ns)
        return header_ns if self.choice == "header" else log_ns

    def note(self, topic: str) -> str | None:
        """A note on missing or differing stamps; empty if there is none."""
        if self.unset:
            return (
                f"{topic}: {self.unset} of {self.messages} headers have no stamp, "
                "took the log time for them"
            )
        if max(abs(self.least_ns), abs(self.most_ns)) < _NOTABLE_NS:
            return None
        other = "log" if self.choice == "header" else "header"
        return (
            f"{topic}: header stamps and log times differ by {self.least_ns / 1e9:.3f} to "
            f"{self.most_ns / 1e9:.3f} s (log - header); took the {self.choice}'s, "
            f"--stamp {other} for the other"
        )

    def facts(self) -> dict:
        """Statistics for conversion.json."""
        return {
            "used": self.choice,
            "headers_without_stamp": self.unset,
            "log_minus_header_s": [self.least_ns / 1e9, self.most_ns / 1e9],
        }
