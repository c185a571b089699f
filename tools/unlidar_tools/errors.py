"""Errors that a user can mend. `cli.main` is the one place that turns them into an exit code."""


class UnlidarError(Exception):
    """One line that names the file, the value and what was expected."""

    exit_code = 1


class UsageError(UnlidarError):
    """The command line asks for something that does not exist or does not fit together."""

    exit_code = 2


class ConfigError(UnlidarError):
    """A scenario or configuration file has a wrong key or value."""

    exit_code = 3


class InputError(UnlidarError):
    """A recording, truth or trajectory cannot be read."""

    exit_code = 4


class OutputError(UnlidarError):
    """A result cannot be written."""

    exit_code = 5


class ForwardedError(UnlidarError):
    """What failed is not the command itself; the exit code of that is handed on."""

    def __init__(self, message: str, exit_code: int):
        super().__init__(message)
        self.exit_code = exit_code


class ProgramError(ForwardedError):
    """`unlidar_track` itself failed."""


class BatchError(ForwardedError):
    """Some of many recordings failed: their exit code, or 1 where they differ."""


def reason(error: BaseException) -> str:
    """What an exception of a library says, on one line and without the path it repeats."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(text.split())
