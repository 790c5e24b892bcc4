"""Recordings in `.rrd` files: log, data set, map and replay of a run. Only this package imports rerun."""
