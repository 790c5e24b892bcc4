"""Pictures, tables and pages: about the network from shards, drives, weights and their card, and about an evaluation.

The one home of matplotlib and jinja2, which come with the extra `docs`. Decides nothing: whatever is
measured is measured by `ltvn_core.network` and `ltvn_core.evaluation`.
"""
