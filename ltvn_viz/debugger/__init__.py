"""The debugger in the page: tools that answer "why", each a fold over the events so far.

Owns no analysis: results come from `ltvn_core.analysis`. A tool turns them into a few lines with links and into a
drawing over the map, the same live and in replay.
"""
