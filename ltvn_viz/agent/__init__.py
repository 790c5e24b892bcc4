"""Read-only tools with which the program of a language model asks about recordings."""
