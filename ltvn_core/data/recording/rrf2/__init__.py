"""The binary format of `.rrd` files (RRF2), as Rerun 0.39 to 0.41 writes it."""
