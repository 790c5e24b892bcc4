"""Lifelong evaluation in a world that changes: the same queries for every maintenance, spread over simulated days."""
