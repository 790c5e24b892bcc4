"""Importing: drives of other programs, in any known format, become recordings.

A reader turns one format into raw frames (`raw_frame.DriveReader`); all further steps are common to all formats.
"""
