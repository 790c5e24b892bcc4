"""Requests of a person on the page: the commands, and the table of the actions that send them."""
