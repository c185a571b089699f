"""`unlidar watch`: a page that shows a running station, served by this machine itself."""
