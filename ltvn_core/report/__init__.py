"""Pictures and tables about the network for `docs/`, all made from shards, drives, weights and their card.

The one home of matplotlib, which comes with the extra `docs`. Decides nothing: whatever is measured is measured by
`ltvn_core.model`.
"""
