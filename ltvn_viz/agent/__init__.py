"""Programs that work by a language model ask about recordings here; they look, and change nothing."""
