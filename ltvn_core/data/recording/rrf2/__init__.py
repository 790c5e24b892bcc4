"""The bytes of a `.rrd` file of the format RRF2, as Rerun 0.39 to 0.41 write it."""
