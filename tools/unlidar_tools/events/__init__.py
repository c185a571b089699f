"""What a running station tells: its events taken in, placed on the globe, alarms raised."""
