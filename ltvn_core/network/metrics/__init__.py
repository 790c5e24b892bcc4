"""The numbers by which a network is judged."""
