"""Measures the program beside others in one run, for docs/performance.md. See tools/bench.sh."""
