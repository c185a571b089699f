"""Measures the program beside others in one run, for docs/performance.md. See tools/bench.sh.

Also the parts of tools/draw_scenes.py and tools/measure_scenes.py.
"""
