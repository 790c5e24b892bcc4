"""What can change in a world, and what a world is like after some changes: data alone, without a simulator."""
