"""Cameras: how a lens projects, how it is mounted, and how one camera's picture becomes another's."""
