"""Recordings, and readers and writers for drives and maps in the formats of other programs."""
