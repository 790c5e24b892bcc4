"""The page: drive, map, click, watch, replay. Imports ltvn_core, never the reverse."""
