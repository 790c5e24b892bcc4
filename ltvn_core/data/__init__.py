"""Recordings, and drives and maps in the formats of other programs."""
