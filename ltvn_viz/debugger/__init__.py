"""The debugger in the page: tools that answer "why", each a fold over what happened until now.

Owns no analysis of its own: what is found out is found out in `ltvn_core.analysis`. A tool turns it into a few lines
with links and into a drawing over the map, the same live and in replay.
"""
