"""What stations told, kept in SQLite: tracks with their rows, alarms, states."""

DAYS, MEGABYTES = 30.0, 500.0  # what is kept where nothing else is said
MEMORY_MEGABYTES = 16.0  # and at most without a file
