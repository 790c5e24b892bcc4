"""The debugger in the page: questions that explain the run, each answered from the events so far.

Owns no analysis: results come from `ltvn_core.analysis`. A question turns them into a few lines with links and into a
drawing over the map, in the same way live and in replay.
"""
