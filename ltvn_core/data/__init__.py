"""Recordings, and drives and maps in the formats of others."""
