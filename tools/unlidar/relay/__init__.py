"""`unlidar relay`: forwards a station's events as they arrive."""
