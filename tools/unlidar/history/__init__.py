"""Storage of stations' events in SQLite: tracks with their rows, alarms, states."""

DAYS, MEGABYTES = 30.0, 500.0  # default retention
MEMORY_MEGABYTES = 16.0  # bound of a store in memory
