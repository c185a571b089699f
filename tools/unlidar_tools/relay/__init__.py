"""`unlidar relay`: a station's events, sent on as they come."""
