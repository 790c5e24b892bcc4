"""The viewer of labelled pairs: a page of its own behind the same guarded door.

`browser` knows which pair is looked at, `panel`, `pictures` and `space` show it, `page` puts them together.
"""
