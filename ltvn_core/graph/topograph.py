"""The map: nodes, directed edges with beliefs, and the reserve T'. Changed only by `apply`.

Owns the structure and its invariants (an edge joins two nodes that are there). Does not own images or features
(`graph.views`) nor decisions (`graph.builder`, `graph.maintenance`).
"""
