"""The session: the running app without its page, with commands as input and snapshots as output."""
