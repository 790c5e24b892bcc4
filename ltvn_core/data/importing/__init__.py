"""Importing: converts drives of other programs, in any known format, to recordings.

A reader turns one format into raw frames (`raw_frame.DriveReader`); all further steps are the same for all formats.
"""
