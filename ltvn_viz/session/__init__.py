"""The running app without its page: commands in, snapshots out."""
