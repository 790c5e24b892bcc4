"""What stands beside weights on disk: where they come from and how good they are."""
