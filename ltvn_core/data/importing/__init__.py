"""Importing: other people's drives, whatever their format, become recordings.

A reader turns one format into raw frames (`raw_frame.DriveReader`); what follows is the same for all of them.
"""
