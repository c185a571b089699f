"""Events of a running station: decoded, georeferenced, fused, checked for alarms."""
