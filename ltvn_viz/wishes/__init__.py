"""What a person can wish for on the page: commands, and the table of the actions that ask for them."""
