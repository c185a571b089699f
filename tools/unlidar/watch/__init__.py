"""`unlidar watch`: web page of a running station, served by this machine."""
