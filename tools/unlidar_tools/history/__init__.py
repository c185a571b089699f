"""What stations told, kept in SQLite: tracks with their rows, alarms, states."""
