"""Wishes of a person on the page: commands, and the table of the actions that send them."""
